"""Regimes of a measured force-displacement curve: `RegimeCurve` fitted by variable projection."""

from dataclasses import dataclass, fields
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from joints.limits import require
from joints.stiffness import RegimeCurve, regime_basis

_LINEAR = ("peak_force", "film_stiffness", "transition_stiffness", "contact_stiffness")
_BREAKS = ("contact_end", "transition_end", "film_end", "stand_off")
_GRID = 14


@dataclass(frozen=True)
class RegimeFit:
    """The fitted curve, standard errors of its numbers and of the magnets' coefficient, rms residual [N], and what
    limits trust."""

    curve: RegimeCurve
    stderr: dict[str, float]
    rms: float
    status: str


def fit_regimes(displacement: ArrayLike, force: ArrayLike) -> RegimeFit:
    """Least squares of `RegimeCurve` to (N,) displacements [m] and tensions [N].

    The four stiffness-like numbers are solved linearly for every trial of the three regime limits and the magnets'
    stand-off, which are searched on a grid of the data's own range and then polished. Raises InputError below 12 rows.
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
    """Gauss-Newton errors of all eight numbers, by central differences of the curve; of K_m = peak s^2 from them."""
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
    """`RegimeCurve.force` without its order check, for steps across a limit."""
    contact, transition, film, peak, *breaks = values
    return np.asarray(regime_basis(x, *breaks) @ np.array([peak, film, transition, contact]))
