"""One force-displacement curve of magnet, film, transition and contact (thesis 4.2.3, Figs 4.14-4.19).

The tester pulls the ball out of the socket along x [m]; tension is positive [N], stiffnesses are dF/dx [N/m].
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from gpmodel.arrays import Array
from joints.film import FilmGeometry, edge_gap, film_resistance
from joints.limits import not_negative, positive, require
from joints.orifice import Orifice

HIGHEST = 1e-3
"""m: a ball that a film lifts further is lost."""


def layer_stiffness(elastic_modulus: ArrayLike, radius: ArrayLike, thickness: ArrayLike) -> Array:
    """E pi r^2 / t [N/m]: replica layer 2702 N/um (Fig 4.18 prints 2700), brass tube 138 (Fig 4.19 prints 140)."""
    area = np.pi * positive("radius", radius, "m") ** 2
    return positive("elastic modulus", elastic_modulus, "Pa") * area / positive("thickness", thickness, "m")


def magnet_force(separation: ArrayLike, preload: float, stand_off: float) -> Array:
    """F = P (s / (s + x))^2 [N], the K_m/x^2 of Fig 4.16 with the distance counted from `stand_off` s below contact.

    The magnets stand 1/32 in behind the replica (thesis 2.2.4), so the pull P at contact is finite and K_m = P s^2.
    """
    gap = not_negative("separation", separation, "m")
    return positive("preload", preload, "N") * (positive("stand-off", stand_off, "m") / (stand_off + gap)) ** 2


def film_force(geometry: FilmGeometry, orifice: Orifice, inlet: float, displacement: ArrayLike) -> Array:
    """Lift [N] of the flat film at constant inlet pressure, P_s A with P_s/R_s = N q(P_i, P_s) by bisection."""
    supply = float(not_negative("inlet pressure", inlet, "Pa"))
    resistance = film_resistance(geometry, edge_gap(geometry, displacement)) * geometry.orifices
    low, high = np.zeros_like(resistance), np.full_like(resistance, supply)
    for _ in range(60):
        middle = (low + high) / 2
        starved = middle < resistance * orifice.flow(supply, middle)
        low, high = np.where(starved, middle, low), np.where(starved, high, middle)
    return (low + high) / 2 * geometry.area


@dataclass(frozen=True)
class RegimeCurve:
    """The four regimes of Fig 4.15, continuous: contact below `contact_end`, transition to `transition_end`, film to
    `film_end` where the tension peaks at `peak_force`, then F = peak (s / (s + x - film_end))^2, s `stand_off`."""

    contact_stiffness: float
    transition_stiffness: float
    film_stiffness: float
    peak_force: float
    contact_end: float
    transition_end: float
    film_end: float
    stand_off: float

    def __post_init__(self) -> None:
        ordered = self.contact_end <= self.transition_end <= self.film_end
        require(ordered, "end of transition", self.transition_end, "between the ends of contact and film")
        positive("stand-off", self.stand_off, "m")

    def force(self, displacement: ArrayLike) -> Array:
        """Measured tension [N] at `displacement` [m]."""
        basis = regime_basis(displacement, self.contact_end, self.transition_end, self.film_end, self.stand_off)
        return basis @ [self.peak_force, self.film_stiffness, self.transition_stiffness, self.contact_stiffness]

    @property
    def magnet_coefficient(self) -> float:
        """K_m = peak s^2 [N m^2] of Fig 4.16."""
        return self.peak_force * self.stand_off**2


def regime_basis(
    displacement: ArrayLike, contact_end: float, transition_end: float, film_end: float, stand_off: float
) -> Array:
    """(N, 4) columns of peak force, film, transition and contact stiffness: the curve is linear in these four."""
    x = np.asarray(displacement, float)
    beyond = np.maximum(x - film_end, 0.0)
    return np.stack(
        [
            (stand_off / (stand_off + beyond)) ** 2,
            -np.clip(film_end - x, 0.0, film_end - transition_end),
            -np.clip(transition_end - x, 0.0, transition_end - contact_end),
            -np.maximum(contact_end - x, 0.0),
        ],
        axis=-1,
    )


def lifted_tension(
    geometry: FilmGeometry, orifice: Orifice, inlet: float, preload: float, stand_off: float, lift: ArrayLike
) -> Array:
    """Predicted tension [N] of magnet less film over the seat, lift [m] ≥ 0 (Fig 4.14)."""
    height = np.asarray(lift, float)
    return magnet_force(height, preload, stand_off) - film_force(geometry, orifice, inlet, height)


def contact_tension(stiffness: float, displacement: ArrayLike) -> Array:
    """Predicted tension [N] of the linear contact, displacement [m] below 0; none above."""
    return positive("contact stiffness", stiffness, "N/m") * np.minimum(np.asarray(displacement, np.float64), 0.0)


def rest_displacement(
    geometry: FilmGeometry, orifice: Orifice, inlet: float, preload: float, stand_off: float
) -> float:
    """Displacement [m] where film and magnets balance; 0 if the film cannot lift the ball off its seat.

    The magnets pull less as the ball rises: 89 N of 100.7 at 50 um, near the 90 N the thesis measured.
    """

    def tension(lift: float) -> float:
        return float(lifted_tension(geometry, orifice, inlet, preload, stand_off, lift))

    if tension(0.0) >= 0:
        return 0.0
    require(tension(HIGHEST) > 0, "inlet pressure", inlet, f"one that holds the ball below {HIGHEST * 1e6:.4g} um")
    return float(brentq(tension, 0.0, HIGHEST, xtol=1e-12))
