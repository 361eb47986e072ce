"""The spherical air film: Reynolds' equation over the real gap, an improvement suggested in thesis section 4.4.1.

Between two eccentric spheres the gap at polar angle t is h(t) = h0 + (d - h0) cos t, d the ball's axial displacement
from contact. The flow across the ring at t is Q = -(pi sin t h^3 / (6 mu)) dp/dt. The orifices are spread over their
ring at phi; below it the film has the socket pressure. Units as in `joints.film`.

Dynamics of a fed air film: compressible air in the gap and behind the orifices, linearised; pneumatic hammer.

Isothermal air of absolute pressure P in the gap h(t) = h0 + (d - h0) cos t, flows as volumes at atmospheric pressure:

    2 pi r^2 sin t d(P h)/dtau / p_a + dQ/dt = feed at the orifices' ring,   Q = -(pi sin t h^3 / (12 mu p_a)) dP^2/dt

Linearised about the steady film that carries the load, with pressures p of n nodes, x of the ball along the axis and
stiffness k of the magnets:

    S dp/dtau = L p + g x - (P w / p_a) dx/dtau,    m d^2x/dtau^2 = w.p - k x

S holds the air of the gap and of a pocket between orifices and film. The pressure of trapped air follows the gap with a
delay. If this delay feeds more energy into the motion than the film dissipates, an eigenvalue has a positive real part:
pneumatic hammer. Source: Licht, Fuller and Sternlicht, Trans. ASME 80 (1958), for one pocket.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_banded
from scipy.optimize import brentq

from gpmodel.arrays import Array
from joints.film import FilmGeometry, feed_factor, film_gap, gap_along
from joints.orifice import ATMOSPHERE, Orifice
from joints.settings import not_negative, positive, require

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


@dataclass(frozen=True)
class SphericalFilm:
    """The film at each displacement: flow through one orifice, socket and inlet pressure, stiffness."""

    displacement: Array
    flow: Array
    socket_pressure: Array
    inlet_pressure: Array
    stiffness_constant_flow: Array
    stiffness_constant_inlet: Array


def spherical_resistance(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """Return R_s = (6 mu / pi) integral from phi to alpha of dt / (sin t h^3) [Pa s/m^3], incompressible.

    Gauss-Legendre quadrature with 24 nodes agrees with adaptive quadrature to 1e-9.
    """
    return 6 * geometry.viscosity / np.pi * _log_integral(geometry, displacement)


def orifice_spreading_resistance(geometry: FilmGeometry, displacement: ArrayLike, orifice_diameter: ArrayLike) -> Array:
    """Return (6 mu / (pi h^3)) ln(r sin(phi) / (N a)) [Pa s/m^3] at the gap over the orifices, a their radius.

    N holes add this resistance, per unit of the flow of one hole, to the source spread evenly over their ring (log
    potentials of N equal sources on a circle). The resistance reduces the inlet pressure. The load is unchanged: if
    the gap does not vary around the axis, the mean pressure around the axis is that of the evenly spread source.
    """
    gap = film_gap(geometry, displacement, geometry.orifice_angle)
    ring = geometry.ball_radius * np.sin(geometry.orifice_angle)
    spread = ring / (geometry.orifices * positive("orifice diameter", orifice_diameter, "m") / 2)
    require(spread > 1, "orifice diameter", orifice_diameter, "smaller than the spacing of the orifices")
    resistance: Array = 6 * geometry.viscosity / (np.pi * gap**3) * np.log(spread)
    return resistance


def spherical_area(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """Return load over socket pressure [m^2]: pi r^2 (integral sin t / h^3 dt) / (integral dt / (sin t h^3))."""
    load_integral = _load_integral(geometry, displacement)
    return np.pi * geometry.ball_radius**2 * load_integral / _log_integral(geometry, displacement)


def spherical_film(geometry: FilmGeometry, load: ArrayLike, orifice: Orifice, displacement: ArrayLike) -> SphericalFilm:
    """Return flow, pressures and stiffnesses of the incompressible spherical film that carries `load` [N].

    W = 6 mu Q r^2 J with J = integral of sin t / h^3, in closed form; both derivatives follow from dh/dd = cos t. At
    constant inlet pressure the orifices reduce the stiffness as in the flat film.
    """
    lift = positive("displacement", displacement, "m")
    weight = not_negative("load", load, "N")
    integral, integral_slope = _log_integral_and_slope(geometry, lift)
    load_integral, load_slope = _load_integral(geometry, lift), _load_integral_slope(geometry, lift)
    resistance = 6 * geometry.viscosity / np.pi * integral
    socket = weight * integral / (np.pi * geometry.ball_radius**2 * load_integral)
    flow = socket / (resistance * geometry.orifices)
    inlet = orifice.inlet_pressure(flow, socket)
    load_rate, resistance_rate = load_slope / load_integral, integral_slope / integral
    area_rate = load_rate - resistance_rate
    feed = feed_factor(geometry, resistance, orifice.flow_slope(inlet, socket))
    return SphericalFilm(lift, flow, socket, inlet, -weight * load_rate, -weight * (area_rate + resistance_rate * feed))


def spherical_pressure(
    geometry: FilmGeometry, displacement: float, socket_pressure: float, angle: ArrayLike, compressible: bool = True
) -> Array:
    """Return the gauge pressure [Pa] at polar angles `angle`.

    Incompressible pressure is linear in G = integral from t to alpha of dt/(sin t h^3); for isothermal air the square
    of the absolute pressure is.
    """
    share = _share(geometry, displacement, angle)
    socket = not_negative("socket pressure", socket_pressure, "Pa")
    if not compressible:
        return socket * share
    return _isothermal(socket, share)


def compressible_film(geometry: FilmGeometry, load: float, displacement: float) -> tuple[float, float]:
    """Return flow through one orifice and socket pressure of isothermal compressible air that carries `load`.

    Flow at atmospheric pressure: pi (p_s^2 - p_a^2) / (12 mu p_a G N), p absolute, G as in `spherical_resistance`.
    """
    target = float(positive("load", load, "N"))
    alpha, phi, r = geometry.socket_angle, geometry.orifice_angle, geometry.ball_radius
    nodes, weights = np.polynomial.legendre.leggauss(48)
    angle = phi + (alpha - phi) * (nodes + 1) / 2
    strip = np.pi * r**2 * np.sin(2 * angle) * weights * (alpha - phi) / 2
    share = _share(geometry, displacement, angle)

    inside = np.pi * (r * np.sin(phi)) ** 2
    socket = float(brentq(lambda s: inside * s + strip @ _isothermal(s, share) - target, 0.0, target / inside))
    resistance = float(spherical_resistance(geometry, displacement))
    return socket * (1 + socket / (2 * ATMOSPHERE)) / (resistance * geometry.orifices), socket


def _isothermal(socket: Array | float, share: Array) -> Array:
    """Return the gauge pressure [Pa] of compressible air. share: incompressible pressure over socket pressure."""
    squared = ATMOSPHERE**2 + ((socket + ATMOSPHERE) ** 2 - ATMOSPHERE**2) * share
    return np.asarray(np.sqrt(squared) - ATMOSPHERE)


def _share(geometry: FilmGeometry, displacement: float, angle: ArrayLike) -> Array:
    """Return G(t) / G(phi), 1 below the orifices and 0 beyond the edge."""
    clipped = np.clip(np.asarray(angle, float), geometry.orifice_angle, geometry.socket_angle)
    return _log_integral(geometry, displacement, clipped) / _log_integral(geometry, displacement)


def _log_integral(geometry: FilmGeometry, displacement: ArrayLike, lower: ArrayLike | None = None) -> Array:
    """Return G: integral from `lower`, by default the orifices, to alpha of dt / (sin t h^3)."""
    lift = np.asarray(displacement, float)
    total: Array | float = 0.0
    for cosine, weight in _rule(geometry, lower):
        gap = gap_along(geometry, lift, cosine)
        total = total + weight / (gap * gap * gap)
    return np.asarray(total)


def _log_integral_and_slope(geometry: FilmGeometry, displacement: ArrayLike) -> tuple[Array, Array]:
    """Return G and dG/dd = -3 integral of cos t / h^4 dt / sin t."""
    lift = np.asarray(displacement, float)
    total, slope = np.zeros_like(lift), np.zeros_like(lift)
    for cosine, weight in _rule(geometry, None):
        gap = gap_along(geometry, lift, cosine)
        term = weight / (gap * gap * gap)
        total += term
        slope -= 3 * cosine * term / gap
    return total, slope


def _rule(geometry: FilmGeometry, lower: ArrayLike | None) -> Iterator[tuple[Array, Array]]:
    """Yield (cos t, weight) of Gauss-Legendre quadrature in s = ln tan(t/2) from `lower` to
    alpha, with dt/sin t = ds."""
    start = np.log(np.tan(np.asarray(geometry.orifice_angle if lower is None else lower, float) / 2))
    half = (np.log(np.tan(geometry.socket_angle / 2)) - start) / 2
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        yield -np.tanh(start + half * (node + 1)), half * weight


def _load_integral(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """Return the integral of sin t / h^3 = (cos phi - cos alpha)(h_phi + h_alpha) / (2 h_phi^2 h_alpha^2)."""
    inner = film_gap(geometry, displacement, geometry.orifice_angle)
    outer = film_gap(geometry, displacement, geometry.socket_angle)
    cosines = float(np.cos(geometry.orifice_angle) - np.cos(geometry.socket_angle))
    return cosines * (inner + outer) / (2 * inner**2 * outer**2)


def _load_integral_slope(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """Return d/dd of `_load_integral`."""
    inner = film_gap(geometry, displacement, geometry.orifice_angle)
    outer = film_gap(geometry, displacement, geometry.socket_angle)
    cos_inner, cos_outer = np.cos(geometry.orifice_angle), np.cos(geometry.socket_angle)
    relative: Array = (cos_inner + cos_outer) / (inner + outer) - 2 * cos_inner / inner - 2 * cos_outer / outer
    return _load_integral(geometry, displacement) * relative


CELLS = 800
"""Cells of the arc from the pole to the edge. Twice as many change the stiffness by 1e-5."""


def lateral_stiffness(
    geometry: FilmGeometry, film: SphericalFilm, orifice: Orifice | None = None, cells: int = CELLS
) -> Array:
    """Return the stiffness -dF/dx [N/m] across the axis at each displacement of a film, pi r² of the integral of p1
    sin² t.

    With an orifice the inlet pressure is constant, without one the flow at each azimuth. A ball moved by x across the
    axis changes the gap h(t) by -x sin t cos f at azimuth f, and the pressure p(t) by x p1(t) cos f to first order.
    Reynolds' equation (incompressible) becomes

        d/dt [ sin t (h³ p1' - 3 h² sin t p') ] - h³ p1 / sin t = -(6 mu / pi) N (dq/dp) p1  at the ring of the
        orifices,

    p1 = 0 at the pole and at the edge; q: flow through one orifice. A rotation of the ball about its centre changes no
    gap, so that the film has no tilt stiffness; about a point at distance L from the centre it has L² times this
    stiffness.
    """
    pressures = film.inlet_pressure, film.socket_pressure
    slopes = np.zeros_like(film.flow) if orifice is None else orifice.flow_slope(*pressures)
    rows = zip(film.displacement.flat, film.socket_pressure.flat, slopes.flat, strict=True)
    found = [_lateral(geometry, float(lift), float(socket), float(slope), cells) for lift, socket, slope in rows]
    return np.array(found).reshape(film.displacement.shape)


def _lateral(geometry: FilmGeometry, lift: float, socket: float, flow_slope: float, cells: int) -> float:
    """Return the lateral stiffness at one displacement, by finite volumes around nodes; one node is at the ring of
    orifices."""
    ring, edge = geometry.orifice_angle, geometry.socket_angle
    inner = max(round(cells * ring / edge), 4)
    node = np.concatenate([np.linspace(0.0, ring, inner + 1), np.linspace(ring, edge, cells - inner + 1)[1:]])
    middle, step = (node[1:] + node[:-1]) / 2, np.diff(node)
    gap = film_gap(geometry, lift, middle)
    outward = 6 * geometry.viscosity * socket / (np.pi * float(spherical_resistance(geometry, lift)))
    driven = np.where(middle > ring, 3 * np.sin(middle) * outward / gap, 0.0)
    conduct = np.sin(middle) * gap**3 / step
    width = (step[1:] + step[:-1]) / 2
    bands = np.zeros((3, len(node) - 2))
    bands[0, 1:] = bands[2, :-1] = conduct[1:-1]
    bands[1] = -conduct[1:] - conduct[:-1] - width * film_gap(geometry, lift, node[1:-1]) ** 3 / np.sin(node[1:-1])
    bands[1, inner - 1] += 6 * geometry.viscosity / np.pi * geometry.orifices * flow_slope
    pressure = solve_banded((1, 1), bands, -np.diff(driven))
    return float(np.pi * geometry.ball_radius**2 * np.sum(width * pressure * np.sin(node[1:-1]) ** 2))


NODES = 120
"""Nodes of the polar angle, in equal steps inside and outside the ring of orifices: eigenvalues to three digits."""
STEEPEST = 50.0
"""Largest exponent of a vibration per cycle; beyond it the vibration decays within a cycle, or is unbounded."""
POCKETS = np.geomspace(0.01, 100.0, 25)
"""Pocket volumes, relative to the gap, among which the smallest unstable one (pneumatic hammer) is searched."""


@dataclass(frozen=True)
class FedFilm:
    """The linearised film, as matrices of the module docstring.

    volume: (n,) m^3 of air at each node.
    pressure: (n,) P, Pa.
    conduct: (3, n) bands of L with the orifices, m^3/(s Pa).
    gap: (n,) g, m^2/s.
    swept: (n,) w, m^2.
    ring: index of the node of the orifices.
    """

    volume: Array
    pressure: Array
    conduct: Array
    gap: Array
    swept: Array
    ring: int

    def impedance(self, frequency: ArrayLike, pocket: float = 0.0) -> NDArray[np.complex128]:
        """Return the complex stiffness -F/x [N/m] at `frequency` [Hz], 0 for static. pocket: volume of all pockets,
        m^3."""
        omega = 2 * np.pi * not_negative("frequency", frequency, "Hz")
        stored, result = self._stored(pocket), np.empty(omega.shape, complex)
        for at, rate in np.ndenumerate(omega):
            bands = -self.conduct.astype(complex)
            bands[1] += 1j * rate * stored
            result[at] = -self.swept @ solve_banded((1, 1), bands, self.gap - 1j * rate * self._pushed)
        return result

    def least_damped(self, mass: float, stiffness: float = 0.0, pocket: float = 0.0) -> complex:
        """Return the eigenvalue s [1/s] with the smallest damping ratio -Re s / |s| and a non-negative imaginary part.

        mass: kg. stiffness: of the magnets, N/m. With a negative ratio the ball hammers, or is sucked in or blown out
        if s is real.
        """
        n, stored, m = len(self.volume), self._stored(pocket), positive("mass", mass, "kg")
        above, within, below = self.conduct
        state = np.zeros((n + 2, n + 2))
        state[:n, :n] = (np.diag(above[1:], 1) + np.diag(within) + np.diag(below[:-1], -1)) / stored[:, None]
        state[:n, n], state[:n, n + 1] = self.gap / stored, -self._pushed / stored
        state[n, n + 1] = 1.0
        state[n + 1, :n], state[n + 1, n] = self.swept / m, -stiffness / m
        found = np.linalg.eigvals(state)
        least = found[np.argmax(found.real / np.abs(found))]
        return complex(least.real, abs(least.imag))

    def hammering_pocket(self, mass: float, stiffness: float = 0.0) -> float:
        """Return the smallest total pocket volume [m^3] with pneumatic hammer.
        0 if it occurs without a pocket, and the largest of POCKETS if no pocket causes it."""

        def grows(pocket: float) -> float:
            least = self.least_damped(mass, stiffness, pocket)
            return least.real / abs(least)

        tried = np.append(0.0, POCKETS * float(self.volume.sum())).tolist()
        first = next((k for k, pocket in enumerate(tried) if grows(pocket) > 0), None)
        if first is None:
            return float(tried[-1])
        return float(brentq(grows, tried[first - 1], tried[first], xtol=1e-6 * tried[first])) if first else 0.0

    @property
    def _pushed(self) -> Array:
        """Flow displaced per unit speed of the ball (n,), m^2 at atmospheric pressure."""
        return self.swept * self.pressure / ATMOSPHERE

    def _stored(self, pocket: float) -> Array:
        """Return the diagonal of S (n,), m^3/Pa."""
        added: Array = not_negative("air pocket", pocket, "m^3") * (np.arange(len(self.volume)) == self.ring)
        return (self.volume + added) / ATMOSPHERE


def left_a_cycle_later(root: complex) -> float:
    """Return the ratio exp(2 pi Re s / Im s) of the amplitudes of a vibration s [1/s] after and before one cycle.
    The exponent is bounded if s does not oscillate."""
    rate = 2 * np.pi * root.real / max(root.imag, abs(root) / STEEPEST)
    return float(np.exp(np.clip(rate, -STEEPEST, STEEPEST)))


def fed_film(geometry: FilmGeometry, load: float, orifice: Orifice, displacement: float) -> FedFilm:
    """Return the film that carries `load` [N] at `displacement` [m], with its orifices at constant inlet pressure."""
    flow, socket = compressible_film(geometry, load, displacement)
    slope = orifice.flow_slope(orifice.inlet_pressure(flow, socket), socket)
    return linearised_film(geometry, displacement, geometry.orifices * flow, geometry.orifices * float(slope))


def linearised_film(
    geometry: FilmGeometry, displacement: float, flow: float = 0.0, slope: float = 0.0, nodes: int = NODES
) -> FedFilm:
    """Return the linearised film with a `flow` [m^3/s] from the ring of orifices to the edge.

    slope: d(flow)/dp [m^3/(s Pa)] at the ring. Finite volumes between the midpoints of nodes use the same areas for
    displaced air and load, so that no energy is gained or lost at rest.
    """
    phi, alpha, r = geometry.orifice_angle, geometry.socket_angle, geometry.ball_radius
    ring = max(round(nodes * phi / alpha), 1)
    angle = np.append(np.linspace(0.0, phi, ring + 1), np.linspace(phi, alpha, nodes - ring + 1)[1:])
    face = (angle[1:] + angle[:-1]) / 2
    gap, start = film_gap(geometry, displacement, face), np.append(0.0, face[:-1])
    conductance = np.pi * np.sin(face) * gap**3 / (12 * geometry.viscosity * ATMOSPHERE * np.diff(angle))
    through = np.where(np.arange(nodes) >= ring, flow, 0.0)
    pressure = np.sqrt(ATMOSPHERE**2 + np.cumsum((through / conductance)[::-1])[::-1])
    swept = np.pi * r**2 * (np.sin(face) ** 2 - np.sin(start) ** 2)
    concentric = 2 * np.pi * r**2 * (np.cos(start) - np.cos(face))
    out, back = 2 * conductance * pressure, 2 * conductance[:-1] * pressure[1:]
    conduct = np.zeros((3, nodes))
    conduct[0, 1:], conduct[1], conduct[2, :-1] = back, -out - np.append(0.0, back), out[:-1]
    conduct[1, ring] += slope
    wider = 3 * np.cos(face) * through / gap
    volume = geometry.clearance * concentric + (displacement - geometry.clearance) * swept
    return FedFilm(volume, pressure, conduct, np.append(0.0, wider[:-1]) - wider, swept, ring)


def squeeze_number(geometry: FilmGeometry, displacement: ArrayLike, frequency: ArrayLike) -> Array:
    """Return the squeeze number 12 mu omega (r alpha)^2 / (p_a h^2), with the gap h at the edge of the socket.
    Well below 1 the air escapes, well above it acts as a spring."""
    gap = film_gap(geometry, displacement, geometry.socket_angle)
    omega = 2 * np.pi * not_negative("frequency", frequency, "Hz")
    length = geometry.ball_radius * geometry.socket_angle
    return 12 * geometry.viscosity * omega * length**2 / (ATMOSPHERE * gap**2)


def squeeze_impedance(
    geometry: FilmGeometry, displacement: float, frequency: ArrayLike, cells: int = 400
) -> NDArray[np.complex128]:
    """Return the complex stiffness -F/x [N/m] of the unfed isothermal film at atmospheric mean pressure.
    Im / omega is the damping of slow motion; the real part is the spring of the trapped air."""
    return linearised_film(geometry, displacement, nodes=cells).impedance(positive("frequency", frequency, "Hz"))
