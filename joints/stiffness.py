"""Force-displacement curve of magnet, film, transition and contact (thesis 4.2.3, Figs 4.14-4.19).

The tester pulls the ball out of the socket along x [m]; tension is positive [N], stiffnesses are dF/dx [N/m].
"""

from dataclasses import dataclass, fields
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq, least_squares

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from joints.film import FilmGeometry, edge_gap, film_resistance
from joints.orifice import Orifice
from joints.settings import not_negative, positive, require

HIGHEST = 1e-3
"""Largest displacement of the ball by the air film, m."""


def layer_stiffness(elastic_modulus: ArrayLike, radius: ArrayLike, thickness: ArrayLike) -> Array:
    """Return the axial stiffness [N/m] of a layer: elastic modulus pi radius^2 / thickness. The replicated layer has
    2702 N/um (Fig 4.18 prints 2700), the brass tube 138 N/um (Fig 4.19 prints 140)."""
    area = np.pi * positive("radius", radius, "m") ** 2
    return positive("elastic modulus", elastic_modulus, "Pa") * area / positive("thickness", thickness, "m")


def magnet_force(separation: ArrayLike, preload: float, stand_off: float) -> Array:
    """Return the pull [N] of the magnets at `separation` x [m] of ball and seat, P (s / (s + x))^2.

    P is the preload at contact. The distance of Fig 4.16's pull K_m/x^2 is measured from a point at the depth s
    (stand_off) below contact, because the magnets are 1/32 in behind the replicated layer (thesis 2.2.4); K_m = P s^2.
    """
    gap = not_negative("separation", separation, "m")
    return positive("preload", preload, "N") * (positive("stand-off", stand_off, "m") / (stand_off + gap)) ** 2


def film_force(geometry: FilmGeometry, orifice: Orifice, inlet: float, displacement: ArrayLike) -> Array:
    """Return the lift [N] of the flat film at constant inlet pressure. Bisection finds the socket pressure at which
    orifice flow and film flow are equal."""
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
    """The four regimes of Fig 4.15 as one continuous curve of the tension F [N] against the displacement x [m].

    Regimes in x: contact to `contact_end`, transition to `transition_end`, film to `film_end`, where F has its maximum
    `peak_force`. Beyond `film_end` the magnets pull with F = peak_force (stand_off / (stand_off + x - film_end))^2.
    """

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
        """Return the tension [N] at `displacement` [m]."""
        basis = regime_basis(displacement, self.contact_end, self.transition_end, self.film_end, self.stand_off)
        return basis @ [self.peak_force, self.film_stiffness, self.transition_stiffness, self.contact_stiffness]

    @property
    def magnet_coefficient(self) -> float:
        """Coefficient K_m = peak_force stand_off^2 [N m^2] of the magnets' pull K_m/x^2 in Fig 4.16."""
        return self.peak_force * self.stand_off**2


def regime_basis(
    displacement: ArrayLike, contact_end: float, transition_end: float, film_end: float, stand_off: float
) -> Array:
    """Return the derivatives (displacements, 4) of the tension, which is linear in its four parameters.
    Order of the parameters: peak force, film stiffness, transition stiffness, contact stiffness."""
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
    """Return the predicted tension [N], pull of the magnets minus lift of the film, at `lift` [m] ≥ 0 (Fig 4.14)."""
    height = np.asarray(lift, float)
    return magnet_force(height, preload, stand_off) - film_force(geometry, orifice, inlet, height)


def contact_tension(stiffness: float, displacement: ArrayLike) -> Array:
    """Return the predicted tension [N] of the linear contact at displacements [m] below 0; zero above 0."""
    return positive("contact stiffness", stiffness, "N/m") * np.minimum(np.asarray(displacement, np.float64), 0.0)


def rest_displacement(
    geometry: FilmGeometry, orifice: Orifice, inlet: float, preload: float, stand_off: float
) -> float:
    """Return the displacement [m] where film and magnets balance; 0 if the film cannot lift the ball off its seat.

    The pull of the magnets falls as the ball rises: 89 N of 100.7 N at 50 um, near the measured 90 N of the thesis.
    """

    def tension(lift: float) -> float:
        return float(lifted_tension(geometry, orifice, inlet, preload, stand_off, lift))

    if tension(0.0) >= 0:
        return 0.0
    require(tension(HIGHEST) > 0, "inlet pressure", inlet, f"one that holds the ball below {HIGHEST * 1e6:.4g} um")
    return float(brentq(tension, 0.0, HIGHEST, xtol=1e-12))


_LINEAR = ("peak_force", "film_stiffness", "transition_stiffness", "contact_stiffness")
_BREAKS = ("contact_end", "transition_end", "film_end", "stand_off")
_GRID = 14


@dataclass(frozen=True)
class RegimeFit:
    """Result of fitting the four regimes of a force-displacement curve.

    curve: the fitted force-displacement curve.
    stderr: standard errors of the parameters of the curve and of the magnets' coefficient, by name.
    rms: RMS residual of the tension, N.
    status: "ok", or the reason why the result is doubtful.
    """

    curve: RegimeCurve
    stderr: dict[str, float]
    rms: float
    status: str


def fit_regimes(displacement: ArrayLike, force: ArrayLike) -> RegimeFit:
    """Fit a `RegimeCurve` to displacements [m] and tensions [N] by least squares.

    Peak force and stiffnesses are solved linearly for every trial of the three regime limits and the magnets'
    stand-off. The regime limits and the stand-off are searched on a grid over the range of the data and then refined.
    Raises InputError below 12 rows.
    """
    x, f = _sorted(displacement, force)
    limits = np.linspace(x[0], x[-1], _GRID + 2)[1:-1]
    span = x[-1] - x[0]
    starts = [np.array([*breaks, span * reach]) for breaks in combinations(limits, 3) for reach in (0.1, 0.5, 2.0)]
    ranked = sorted(starts, key=lambda start: float(np.sum(_residual(start, x, f) ** 2)))
    lower = [x[0], x[0], x[0], 1e-3 * span]
    upper = [x[-1], x[-1], x[-1], 1e3 * span]
    scale = [span, span, span, span]
    solutions = [
        least_squares(_residual, start, args=(x, f), bounds=(lower, upper), x_scale=scale, max_nfev=200)
        for start in ranked[:4]
    ]
    breaks = _ordered(min(solutions, key=lambda solution: solution.cost).x)
    linear = _linear_part(breaks, x, f)
    curve = RegimeCurve(**dict(zip(_LINEAR, linear, strict=True)), **dict(zip(_BREAKS, breaks, strict=True)))
    residual = curve.force(x) - f
    stderr, reason = _standard_errors(curve, x, residual)
    negative = [name for name in _LINEAR if getattr(curve, name) <= 0]
    status = f"not a preloaded joint's curve: {', '.join(negative)} not above 0" if negative else reason
    return RegimeFit(curve, stderr, float(np.sqrt(np.mean(residual**2))), status)


def _sorted(displacement: ArrayLike, force: ArrayLike) -> tuple[Array, Array]:
    x, f = np.asarray(displacement, float).ravel(), np.asarray(force, float).ravel()
    if x.size != f.size or x.size < 12:
        raise InputError(
            f"force-displacement data: {x.size} displacements and {f.size} forces, expected at least 12 pairs"
        )
    require(np.isfinite(x), "displacement", x, "finite numbers")
    require(np.isfinite(f), "force", f, "finite numbers")
    require(np.ptp(x) > 0, "range of displacement", np.ptp(x), "above 0 m")
    order = np.argsort(x, kind="stable")
    return x[order], f[order]


def _ordered(breaks: Array) -> Array:
    return np.concatenate([np.sort(breaks[:3]), breaks[3:]])


def _linear_part(breaks: Array, x: Array, f: Array) -> Array:
    basis = regime_basis(x, *_ordered(breaks))
    scale: Array = np.linalg.norm(basis, axis=0)
    scale[scale == 0] = 1.0
    return np.linalg.lstsq(basis / scale, f, rcond=1e-10)[0] / scale


def _residual(breaks: Array, x: Array, f: Array) -> Array:
    return regime_basis(x, *_ordered(breaks)) @ _linear_part(breaks, x, f) - f


def _standard_errors(curve: RegimeCurve, x: Array, residual: Array) -> tuple[dict[str, float], str]:
    """Return the standard errors of the eight parameters, by central differences, and of the magnets' coefficient; and
    a status text."""
    names = [field.name for field in fields(RegimeCurve)]
    values = np.array([getattr(curve, name) for name in names])
    span = np.ptp(x)
    steps = np.array([abs(v) * 1e-6 if name in _LINEAR else span * 1e-6 for name, v in zip(names, values, strict=True)])
    basis = np.column_stack(
        [(_force(values + step, x) - _force(values - step, x)) / (2 * np.abs(step).max()) for step in np.diag(steps)]
    )
    scale = np.linalg.norm(basis, axis=0)
    if np.any(scale == 0) or np.linalg.cond(basis / np.where(scale == 0, 1, scale)) > 1e8:
        return dict.fromkeys([*names, "magnet_coefficient"], float("nan")), "some regimes are not seen in the data"
    noise = residual @ residual / max(x.size - len(names), 1)
    covariance = np.linalg.inv((basis / scale).T @ (basis / scale)) * noise / np.outer(scale, scale)
    slope = np.zeros(len(names))
    slope[names.index("peak_force")] = curve.stand_off**2
    slope[names.index("stand_off")] = 2 * curve.peak_force * curve.stand_off
    errors = [*np.sqrt(np.diag(covariance)).tolist(), float(np.sqrt(slope @ covariance @ slope))]
    return dict(zip([*names, "magnet_coefficient"], errors, strict=True)), "ok"


def _force(values: Array, x: Array) -> Array:
    """Return `RegimeCurve.force` without a check that the ends of the regimes are in order."""
    contact, transition, film, peak, *breaks = values
    return np.asarray(regime_basis(x, *breaks) @ np.array([peak, film, transition, contact]))
