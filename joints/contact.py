"""Hertz contact of two curved elastic bodies (thesis section 3.5), exact and as computed in the thesis.

Exact solution: Johnson, Contact Mechanics (1985), section 4.2, with the elliptic integrals in Carlson's form, so
that circles and long ellipses are equally accurate. Published solution: Slocum, Precision Machine Design (1992),
exponential fits of the contact coefficients alpha, beta (semi-axes; Table 3.3) and lambda (approach; Fig 3.23).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq, minimize_scalar
from scipy.special import ellipk, elliprd

from gpmodel.arrays import Array
from joints.settings import not_negative, positive, require


@dataclass(frozen=True)
class LoopPart:
    """One part of the chain of parts whose thermal growth moves the tool relative to the measuring base.

    length: length of the part along the axis, m, negative for a part in the opposite direction.
    expansion: coefficient of thermal expansion, 1/K.
    """

    name: str
    length: float
    expansion: float

    @property
    def growth_per_kelvin(self) -> float:
        """Thermal growth of the part per kelvin, m/K: coefficient of expansion times length."""
        return self.expansion * self.length


def growth(length: ArrayLike, expansion: ArrayLike, temperature_change: ArrayLike) -> Array:
    """Return the thermal growth [m] of a part: expansion times length times temperature change. Example: 1.17 um/K for
    the 50.8 mm aluminium socket, for which the thesis prints "about 1"."""
    warmer = np.asarray(temperature_change, np.float64)
    return np.asarray(expansion, np.float64) * np.asarray(length, np.float64) * warmer


def loop_growth(parts: Sequence[LoopPart], temperature_change: ArrayLike) -> Array:
    """Return the growth [m] of a chain of parts whose temperature rises by `temperature_change` [K]."""
    total = sum(part.growth_per_kelvin for part in parts)
    return total * np.asarray(temperature_change, float)


def gap_growth(
    ball_radius: float,
    layer: float,
    ball_expansion: float,
    layer_expansion: float,
    socket_expansion: float,
    temperature_change: ArrayLike,
) -> Array:
    """Return the growth [m] of the gap between ball and socket: that of the bore minus those of layer and ball."""
    bore = socket_expansion * (positive("ball radius", ball_radius, "m") + not_negative("layer", layer, "m"))
    per_kelvin = bore - layer_expansion * layer - ball_expansion * ball_radius
    return per_kelvin * np.asarray(temperature_change, np.float64)


def allowed_temperature_change(tolerance: ArrayLike, growth_per_kelvin: ArrayLike) -> Array:
    """Return the temperature change [K] at which the thermal growth equals `tolerance` [m]; infinite without growth."""
    rate: Array = np.abs(np.asarray(growth_per_kelvin, float))
    with np.errstate(divide="ignore"):
        return positive("tolerance", tolerance, "m") / rate


@dataclass(frozen=True)
class Body:
    """An elastic body at a contact.

    major_radius, minor_radius: principal radii of curvature, m, negative if concave, inf if flat.
    elastic_modulus: elastic modulus, Pa.
    poisson: Poisson's ratio.
    """

    major_radius: float
    minor_radius: float
    elastic_modulus: float
    poisson: float = 0.3

    def __post_init__(self) -> None:
        for name, radius in (("major radius", self.major_radius), ("minor radius", self.minor_radius)):
            require(radius != 0 and not np.isnan(radius), name, radius, "a radius other than 0 m")
        positive("elastic modulus", self.elastic_modulus, "Pa")
        require(-1 < self.poisson <= 0.5, "Poisson's ratio", self.poisson, "above -1 and at most 0.5")


@dataclass(frozen=True)
class HertzContact:
    """A Hertz contact: semi-axes of the contact ellipse [m], peak pressure [Pa], approach of the bodies [m] and
    stiffness [N/m] (derivative of the force with respect to the approach)."""

    semi_major: Array
    semi_minor: Array
    pressure: Array
    approach: Array
    stiffness: Array


def contact_modulus(one: Body, two: Body) -> float:
    """Return the contact modulus 1 / ((1 - nu1^2)/E1 + (1 - nu2^2)/E2) [Pa]: elastic moduli E, Poisson's ratios nu."""
    return 1 / sum((1 - body.poisson**2) / body.elastic_modulus for body in (one, two))


def relative_curvatures(one: Body, two: Body, angle: float = 0.0) -> tuple[float, float]:
    """Return A <= B [1/m]: the distance of the surfaces of two touching bodies is A x^2 + B y^2 near the contact.

    angle: angle between the planes of minor curvature, rad. With the principal curvatures k of both bodies, 2 (A + B)
    is their sum, and 2 (B - A) = sqrt(d1^2 + d2^2 + 2 d1 d2 cos(2 angle)), with d1, d2 the difference k_minor - k_major
    of either body.
    """
    total = sum(1 / body.major_radius + 1 / body.minor_radius for body in (one, two))
    first, second = (1 / body.minor_radius - 1 / body.major_radius for body in (one, two))
    difference = np.sqrt(max(first**2 + second**2 + 2 * first * second * np.cos(2 * angle), 0.0))
    small, large = (total - difference) / 4, (total + difference) / 4
    require(small > 1e-13 * abs(large), "smallest relative curvature", small, "above 0 1/m: a point contact")
    return float(small), float(large)


def hertz(force: ArrayLike, one: Body, two: Body, angle: float = 0.0) -> HertzContact:
    """Return the Hertz contact of two bodies under `force` [N].

    Example: two steel balls of 25.4 and 6.3 mm under 100 N have 4.5 um approach and 2.1 GPa peak pressure. Equations: A
    = p b R_D(0, k^2, 1) / (3 E* a^2), B = p b R_D(0, 1, k^2) / (3 E* a^2), approach = p b K(1 - k^2) / E*, force = 2 pi
    a b p / 3; semi-axes a, b = k a, peak pressure p, curvatures A, B, Carlson's R_D, elliptic integral K.
    """
    load = positive("contact force", force, "N")
    small, large = relative_curvatures(one, two, angle)
    modulus = contact_modulus(one, two)
    k = _axis_ratio(large / small)
    minor_integral = float(elliprd(0, k**2, 1)) / 3
    semi_major = np.cbrt(3 * load * minor_integral / (2 * np.pi * modulus * small))
    pressure = 3 * load / (2 * np.pi * k * semi_major**2)
    approach = pressure * k * semi_major * ellipk(1 - k**2) / modulus
    return HertzContact(semi_major, k * semi_major, pressure, approach, 1.5 * load / approach)


def first_yield_pressure(yield_stress: ArrayLike, poisson: float = 0.3) -> Array:
    """Return the peak pressure [Pa] at which a circular contact first yields (Tresca, below the surface).

    For Poisson's ratio nu = 0.3 the peak pressure p is 1.61 times the yield stress. On the axis of the contact, at the
    depth s times the contact radius, the stresses sigma_z and sigma_r satisfy |sigma_z - sigma_r| / p = |3/2/(1 + s^2)
    - (1 + nu)(1 - s atan(1/s))|, with peak pressure p and Poisson's ratio nu (Johnson 3.45).
    """

    def shear(s: float) -> float:
        return -abs(1.5 / (1 + s * s) - (1 + poisson) * (1 - s * float(np.arctan(1 / s))))

    deepest = minimize_scalar(shear, bounds=(0.05, 3.0), method="bounded", options={"xatol": 1e-10})
    return positive("yield stress", yield_stress, "Pa") / -float(deepest.fun)


@dataclass(frozen=True)
class PublishedContact(HertzContact):
    """Rows of Table 3.3 of Robertson (2003) in SI units: Slocum's coefficients and the contact computed from them."""

    equivalent_radius: float
    cos_theta: float
    theta: float
    alpha: float
    beta: float
    lam: float


def published_hertz(force: ArrayLike, one: Body, two: Body, angle: float = 0.0) -> PublishedContact:
    """Return the contact of two bodies by Slocum's formulas, as in the spreadsheet of the thesis' Table 3.3.

    Semi-axes c, d = (alpha, beta)(3 F Re/(2 E*))^(1/3), approach delta = lambda (2 F^2/(3 Re E*^2))^(1/3); force F,
    equivalent radius Re, contact modulus E*. The thesis enters a major radius of 1e6 m for both balls, which makes them
    parallel cylinders (0.50 um); with equal radii the formulas give 4.5 um, as `hertz` does. The stiffness is F/delta.
    """
    load = positive("contact force", force, "N")
    small, large = relative_curvatures(one, two, angle)
    modulus = contact_modulus(one, two)
    radius = 1 / (2 * (small + large))
    cos_theta = (large - small) / (large + small)
    theta = float(np.arccos(cos_theta))
    alpha = 1.939 * np.exp(-5.26 * theta) + 1.78 * np.exp(-1.09 * theta) + 0.723 / theta + 0.221
    beta = 35.228 * np.exp(-0.98 * theta) - 32.424 * np.exp(-1.0475 * theta) + 1.486 * theta - 2.634
    lam = -0.214 * np.exp(-4.95 * theta) - 0.179 * theta**2 + 0.555 * theta + 0.319
    scale = np.cbrt(3 * load * radius / (2 * modulus))
    approach = lam * np.cbrt(2 * load**2 / (3 * radius * modulus**2))
    pressure = 3 * load / (2 * np.pi * alpha * beta * scale**2)
    ellipse = alpha * scale, beta * scale, pressure, approach, load / approach
    return PublishedContact(*ellipse, radius, cos_theta, theta, float(alpha), float(beta), float(lam))


def _axis_ratio(curvature_ratio: float) -> float:
    """Return the ratio k in (0, 1] of the semi-axes of a contact: R_D(0, 1, k^2)/R_D(0, k^2, 1) = curvature_ratio."""

    def excess(log_k: float) -> float:
        k2 = np.exp(2 * log_k)
        return float(np.log(elliprd(0, 1, k2) / elliprd(0, k2, 1) / curvature_ratio))

    return float(np.exp(brentq(excess, -30.0, 0.0, xtol=1e-14))) if curvature_ratio > 1 else 1.0
