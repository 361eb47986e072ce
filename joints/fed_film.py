"""Dynamics of a fed air film: compressible air in the gap and behind the orifices, linearised; pneumatic hammer.

Isothermal air of absolute pressure P in the gap h(t) = h0 + (d - h0) cos t, flows as volumes at atmospheric pressure:

    2 pi r^2 sin t d(P h)/dtau / p_a + dQ/dt = feed at the orifices' ring,   Q = -(pi sin t h^3 / (12 mu p_a)) dP^2/dt

Linearised about the steady film that carries the load, with pressures p of n nodes, x of the ball along the axis and
stiffness k of the magnets:

    S dp/dtau = L p + g x - (P w / p_a) dx/dtau,    m d^2x/dtau^2 = w.p - k x

S holds the air of the gap and of a pocket between orifices and film. The pressure of trapped air follows the gap with a
delay. If this delay feeds more energy into the motion than the film dissipates, an eigenvalue has a positive real part:
pneumatic hammer. Source: Licht, Fuller and Sternlicht, Trans. ASME 80 (1958), for one pocket.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_banded
from scipy.optimize import brentq

from gpmodel.arrays import Array
from joints.film import FilmGeometry, film_gap
from joints.orifice import ATMOSPHERE, Orifice
from joints.reynolds import compressible_film
from joints.settings import not_negative, positive

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
