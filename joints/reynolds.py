"""The spherical air film: Reynolds' equation over the real gap, an improvement suggested in thesis section 4.4.1.

Between two eccentric spheres the gap at polar angle t is h(t) = h0 + (d - h0) cos t: radial clearance h0, axial
displacement d of the ball from contact. The flow across the circle at t is Q = -(pi sin t h^3 / (6 mu)) dp/dt. Orifices
are spread over a ring at polar angle phi. Between the pole and the ring of orifices, the film has the socket pressure.

Dynamics of a fed air film: compressible air in the gap and behind the orifices, linearised; pneumatic hammer.

Isothermal air has the absolute pressure P in the gap h(t); its flows are volumes at the atmospheric pressure p_a:

    2 pi r^2 sin t d(P h)/dtau / p_a + dQ/dt = feed at the orifices' ring,   Q = -(pi sin t h^3 / (12 mu p_a)) dP^2/dt

The equations are linearised about the steady film. p: pressure changes at n nodes; x: displacement of the ball of mass
m along the axis; k: stiffness of the magnets; w: areas that the nodes displace:

    S dp/dtau = L p + g x - (P w / p_a) dx/dtau,    m d^2x/dtau^2 = w.p - k x

S holds the air of the gap and of a pocket between orifices and film. The pressure of trapped air follows the gap with a
delay. If this delay feeds more energy into the motion than the film dissipates, an eigenvalue has a positive real part:
pneumatic hammer. Source: Licht, Fuller and Sternlicht, ASME 80 (1958), for one pocket.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_banded
from scipy.optimize import brentq

from gpmodel.arrays import Array
from joints.film import Film, FilmGeometry, feed_factor, film_gap, gap_along
from joints.orifice import ATMOSPHERE, Orifice
from joints.settings import not_negative, positive, require

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


def spherical_resistance(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """Return pressure over flow [Pa s/m^3] of incompressible air between the orifices and the edge of the socket.

    The resistance is 6 mu / pi times the integral of dt / (sin t h^3) over the polar angle t, with gap h and viscosity
    mu. Gauss-Legendre quadrature with 24 nodes agrees with adaptive quadrature to 1e-9.
    """
    return 6 * geometry.viscosity / np.pi * _log_integral(geometry, displacement)


def orifice_spreading_resistance(geometry: FilmGeometry, displacement: ArrayLike, orifice_diameter: ArrayLike) -> Array:
    """Return the extra flow resistance [Pa s/m^3] of N separate holes, compared with a feed spread evenly on their
    ring.

    Pressure drop per flow of one hole: (6 mu / (pi h^3)) ln(ring radius / (N hole radius)), gap h over the holes (log
    potentials of N equal sources on a circle). The extra resistance raises the inlet pressure. Holes in place
    of an evenly spread feed leave the load unchanged if the gap is constant around the axis.
    """
    gap = film_gap(geometry, displacement, geometry.orifice_angle)
    ring = geometry.ball_radius * np.sin(geometry.orifice_angle)
    spread = ring / (geometry.orifices * positive("orifice diameter", orifice_diameter, "m") / 2)
    require(spread > 1, "orifice diameter", orifice_diameter, "smaller than the spacing of the orifices")
    resistance: Array = 6 * geometry.viscosity / (np.pi * gap**3) * np.log(spread)
    return resistance


def spherical_area(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """Return load over socket pressure [m^2]: pi r^2 ∫ sin t / h^3 dt / ∫ dt / (sin t h^3), gap h(t), ball radius r."""
    load_integral = _load_integral(geometry, displacement)
    return np.pi * geometry.ball_radius**2 * load_integral / _log_integral(geometry, displacement)


def spherical_film(geometry: FilmGeometry, load: ArrayLike, orifice: Orifice, displacement: ArrayLike) -> Film:
    """Return flow, pressures and stiffnesses of the incompressible spherical film that carries `load` [N].

    load = 6 mu r^2 flow integral(sin t / h^3 dt) at ball radius r, gap h and polar angle t, in closed form; stiffnesses
    follow from the derivative cos t of the gap with respect to the displacement of the ball. At constant inlet
    pressure, orifices reduce the film's stiffness as in the flat-plate film.
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
    return Film(lift, flow, socket, inlet, -weight * load_rate, -weight * (area_rate + resistance_rate * feed))


def spherical_pressure(
    geometry: FilmGeometry, displacement: float, socket_pressure: float, angle: ArrayLike, compressible: bool = True
) -> Array:
    """Return the gauge pressure [Pa] of the film at polar angles `angle`, rad.

    The gauge pressure of incompressible air is linear in G, the integral of dt / (sin t h^3) from `angle` to the edge.
    For isothermal air, the square of the absolute pressure is linear in the integral G.
    """
    share = _share(geometry, displacement, angle)
    socket = not_negative("socket pressure", socket_pressure, "Pa")
    if not compressible:
        return socket * share
    return _isothermal(socket, share)


def compressible_film(geometry: FilmGeometry, load: float, displacement: float) -> tuple[float, float]:
    """Return flow [m^3/s] of one orifice and socket pressure [Pa] of isothermal compressible air that carries `load`.

    The flow is pi (p_s^2 - p_a^2) / (12 mu p_a G N), with absolute pressures p_s in the socket and p_a outside,
    viscosity mu, N orifices and the integral G of dt / (sin t h^3).
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
    """Return the gauge pressure [Pa] of isothermal air. share: pressure of incompressible air over socket pressure."""
    squared = ATMOSPHERE**2 + ((socket + ATMOSPHERE) ** 2 - ATMOSPHERE**2) * share
    return np.asarray(np.sqrt(squared) - ATMOSPHERE)


def _share(geometry: FilmGeometry, displacement: float, angle: ArrayLike) -> Array:
    """Return the pressure at polar angles over the pressure at the orifices, for incompressible air."""
    clipped = np.clip(np.asarray(angle, float), geometry.orifice_angle, geometry.socket_angle)
    return _log_integral(geometry, displacement, clipped) / _log_integral(geometry, displacement)


def _log_integral(geometry: FilmGeometry, displacement: ArrayLike, lower: ArrayLike | None = None) -> Array:
    """Return the integral of dt / (sin t h^3), h(t) the gap, from polar angle `lower` (default: orifices) to the
    edge."""
    lift = np.asarray(displacement, float)
    total: Array | float = 0.0
    for cosine, weight in _rule(geometry, lower):
        gap = gap_along(geometry, lift, cosine)
        total = total + weight / (gap * gap * gap)
    return np.asarray(total)


def _log_integral_and_slope(geometry: FilmGeometry, displacement: ArrayLike) -> tuple[Array, Array]:
    """Return the integral of dt / (sin t h^3) from orifices to edge, h the gap, and its derivative by the ball's
    displacement."""
    lift = np.asarray(displacement, float)
    total, slope = np.zeros_like(lift), np.zeros_like(lift)
    for cosine, weight in _rule(geometry, None):
        gap = gap_along(geometry, lift, cosine)
        term = weight / (gap * gap * gap)
        total += term
        slope -= 3 * cosine * term / gap
    return total, slope


def _rule(geometry: FilmGeometry, lower: ArrayLike | None) -> Iterator[tuple[Array, Array]]:
    """Yield (cos t, weight) of a Gauss-Legendre quadrature over dt / sin t, from the polar angle `lower` to the
    edge."""
    start = np.log(np.tan(np.asarray(geometry.orifice_angle if lower is None else lower, float) / 2))
    half = (np.log(np.tan(geometry.socket_angle / 2)) - start) / 2
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        yield -np.tanh(start + half * (node + 1)), half * weight


def _load_integral(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """Return the integral of sin t / h^3 dt, h the gap at polar angle t, from orifices to edge, in closed form."""
    inner = film_gap(geometry, displacement, geometry.orifice_angle)
    outer = film_gap(geometry, displacement, geometry.socket_angle)
    cosines = float(np.cos(geometry.orifice_angle) - np.cos(geometry.socket_angle))
    return cosines * (inner + outer) / (2 * inner**2 * outer**2)


def _load_integral_slope(geometry: FilmGeometry, displacement: ArrayLike) -> Array:
    """Return the derivative of `_load_integral` with respect to the displacement of the ball."""
    inner = film_gap(geometry, displacement, geometry.orifice_angle)
    outer = film_gap(geometry, displacement, geometry.socket_angle)
    cos_inner, cos_outer = np.cos(geometry.orifice_angle), np.cos(geometry.socket_angle)
    relative: Array = (cos_inner + cos_outer) / (inner + outer) - 2 * cos_inner / inner - 2 * cos_outer / outer
    return _load_integral(geometry, displacement) * relative


CELLS = 800
"""Number of cells of the arc from the pole to the edge. With twice as many cells the stiffness changes by 1e-5."""


def lateral_stiffness(geometry: FilmGeometry, film: Film, orifice: Orifice | None = None, cells: int = CELLS) -> Array:
    """Return the lateral stiffness [N/m] of an air film (lateral force per lateral displacement) at each axial
    displacement.

    The stiffness is pi r² times the integral of p1 sin² t over the polar angle t, with ball radius r and pressure
    change p1. With an orifice the inlet pressure is constant; without one, the flow at each azimuth is constant. A
    lateral move x of the ball changes the gap h(t) at azimuth f by -x sin t cos f, and the pressure p(t) by x p1(t) cos
    f to first order. Reynolds' equation (incompressible) becomes

        d/dt [ sin t (h³ p1' - 3 h² sin t p') ] - h³ p1 / sin t = -(6 mu / pi) N (dq/dp) p1  at the ring of the
        orifices,

    p1 = 0 at the pole and at the edge; q: flow through one orifice, N: number of orifices. A rotation of the ball about
    its centre changes no gap, so that the film has no tilt stiffness. For a rotation about a point at distance L from
    the centre, the tilt stiffness is L² times the lateral stiffness.
    """
    pressures = film.inlet_pressure, film.socket_pressure
    slopes = np.zeros_like(film.flow) if orifice is None else orifice.flow_slope(*pressures)
    rows = zip(film.displacement.flat, film.socket_pressure.flat, slopes.flat, strict=True)
    found = [_lateral(geometry, float(lift), float(socket), float(slope), cells) for lift, socket, slope in rows]
    return np.array(found).reshape(film.displacement.shape)


def _lateral(geometry: FilmGeometry, lift: float, socket: float, flow_slope: float, cells: int) -> float:
    """Return the lateral stiffness [N/m] at one displacement, by finite volumes; a node is at the ring of orifices."""
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
"""Number of nodes of the polar angle, in equal steps in and outside the ring of orifices: eigenvalues to 3 digits."""
STEEPEST = 50.0
"""Limit of a vibration's log amplitude ratio over a cycle; beyond, the vibration dies out or is unbounded."""
POCKETS = np.geomspace(0.01, 100.0, 25)
"""Volumes of air pockets behind the orifices, relative to the gap's volume, at which pneumatic hammer is sought."""


@dataclass(frozen=True)
class FedFilm:
    """The linearised film: vectors and matrices at n nodes of the polar angle, as in the module docstring.

    volume: air volume at each node, (n,) m^3.
    pressure: absolute pressure at each node, (n,) Pa.
    conduct: three diagonals (3, n) of the matrix of flow per pressure, with the orifices, m^3/(s Pa).
    gap: flow into each node per displacement of the ball, (n,) m^2/s.
    swept: area that the ball displaces at each node, (n,) m^2.
    ring: index of the node of the orifices, from 0.
    """

    volume: Array
    pressure: Array
    conduct: Array
    gap: Array
    swept: Array
    ring: int

    def impedance(self, frequency: ArrayLike, pocket: float = 0.0) -> NDArray[np.complex128]:
        """Return the complex stiffness [N/m] of the film (force over displacement) at `frequency` [Hz], 0 for static.
        pocket: total volume of the air pockets behind the orifices, m^3."""
        omega = 2 * np.pi * not_negative("frequency", frequency, "Hz")
        stored, result = self._stored(pocket), np.empty(omega.shape, complex)
        for at, rate in np.ndenumerate(omega):
            bands = -self.conduct.astype(complex)
            bands[1] += 1j * rate * stored
            result[at] = -self.swept @ solve_banded((1, 1), bands, self.gap - 1j * rate * self._pushed)
        return result

    def least_damped(self, mass: float, stiffness: float = 0.0, pocket: float = 0.0) -> complex:
        """Return the eigenvalue s [1/s] with the smallest damping ratio -Re s / |s|; imaginary part not negative.

        mass: mass of the ball, kg. stiffness: stiffness of the magnets, N/m. A negative damping ratio means pneumatic
        hammer or, for a real eigenvalue, that the ball is sucked in or blown out.
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
        """Return the smallest total volume [m^3] of the air pockets that causes pneumatic hammer. The volume is 0 if
        hammer occurs without a pocket, and the largest trial volume if no pocket causes hammer."""

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
        """Flow that the ball displaces per unit speed, m^2, at each node, as volume at atmospheric pressure."""
        return self.swept * self.pressure / ATMOSPHERE

    def _stored(self, pocket: float) -> Array:
        """Return the stored air per pressure at each node, m^3/Pa: the diagonal of the matrix S."""
        added: Array = not_negative("air pocket", pocket, "m^3") * (np.arange(len(self.volume)) == self.ring)
        return (self.volume + added) / ATMOSPHERE


def decay_per_cycle(root: complex) -> float:
    """Return the ratio of the amplitudes after and before one cycle of a vibration with eigenvalue `root` [1/s]. The
    logarithm of the amplitude ratio is at most 50."""
    rate = 2 * np.pi * root.real / max(root.imag, abs(root) / STEEPEST)
    return float(np.exp(np.clip(rate, -STEEPEST, STEEPEST)))


def fed_film(geometry: FilmGeometry, load: float, orifice: Orifice, displacement: float) -> FedFilm:
    """Return the linearised film that carries `load` [N] at `displacement` [m], with constant inlet pressure."""
    flow, socket = compressible_film(geometry, load, displacement)
    slope = orifice.flow_slope(orifice.inlet_pressure(flow, socket), socket)
    return linearised_film(geometry, displacement, geometry.orifices * flow, geometry.orifices * float(slope))


def linearised_film(
    geometry: FilmGeometry, displacement: float, flow: float = 0.0, slope: float = 0.0, nodes: int = NODES
) -> FedFilm:
    """Return the linearised film with a `flow` [m^3/s] from the ring of orifices to the edge.

    slope: derivative of the flow with respect to the pressure [m^3/(s Pa)] at the ring. Finite volumes between the
    midpoints of nodes use equal areas for displaced air and load, so that no energy is gained or lost at rest.
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
    """Return the squeeze number 12 mu omega (r alpha)^2 / (p_a h^2): viscosity mu, angular frequency omega, ball radius
    r, atmospheric pressure p_a, polar angle alpha and gap h of the socket's edge. Air escapes from the film at squeeze
    numbers well below 1, and acts as a spring at numbers well above 1."""
    gap = film_gap(geometry, displacement, geometry.socket_angle)
    omega = 2 * np.pi * not_negative("frequency", frequency, "Hz")
    length = geometry.ball_radius * geometry.socket_angle
    return 12 * geometry.viscosity * omega * length**2 / (ATMOSPHERE * gap**2)


def squeeze_impedance(
    geometry: FilmGeometry, displacement: float, frequency: ArrayLike, cells: int = 400
) -> NDArray[np.complex128]:
    """Return the complex stiffness [N/m], force over displacement, of the unfed isothermal film at atmospheric
    pressure. The stiffness's imaginary part over the angular frequency is the damping of slow motion; its real part is
    the spring of the trapped air."""
    return linearised_film(geometry, displacement, nodes=cells).impedance(positive("frequency", frequency, "Hz"))
