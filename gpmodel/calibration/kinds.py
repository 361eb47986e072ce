"""Estimate the noise of each kind of measurement in a table (variance components) from the residual of a fit."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.iterate import STEP_TOLERANCE, Fitted, Fitting
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.priors import fit_priors
from gpmodel.model.observation import Observation, Weights, weight_of
from gpmodel.numerics import rank as ident
from gpmodel.numerics.least_squares import outlier_limit

LOG_SPREAD = np.log(10.0)
"""Prior standard deviation of the log ratio of the noise of two kinds: a factor of ten. The prior matters only for a
kind whose measurements are hardly more than its unknowns."""
LARGEST_LOG = 50.0
"""Bound of the log ratio of two kinds' noise, beyond the ratio of any two lengths that occur."""
STEPS, SETTLED = 30, 0.01
"""Largest number of iterations for the noise of the kinds, and change of a log noise at which they end."""


def reference_kind(kinds: Sequence[Observation]) -> Observation:
    """Return the kind of measurement that scales all residuals: the most redundant of lengths, else of all kinds."""
    lengths = [kind for kind in kinds if kind.unit == "m"]
    return max(lengths or kinds, key=lambda kind: int(kind.readings.sum()) - sum(map(len, kind.own.values())))


def estimated_weights(fitting: Fitting, fitted: Fitted, kept: Mask) -> Weights:
    """Return the length, m, that counts as one unit of each kind of measurement, so that all kinds have equal noise.

    kept: mask of the fitted effects. The noise variance σ_k² of a kind is its sum of squares S_k over its redundancy
    r_k = n_k - tr(N⁻¹ A_kᵀ A_k), for n_k measurements with columns A_k, and the normal matrix N of all kinds with the
    weights 1 / σ_k². Both sides are iterated. Source: Förstner (1979), restricted maximum likelihood.
    """
    problem = fitted.problem
    kinds = [kind for kind in problem.observed.kinds if kind.readings[fitting.use].any()]
    reference = reference_kind(kinds)
    if len(kinds) == 1:
        return {**fitting.weights, reference.name: reference.metres}
    priors = fit_priors(fitting.model, problem, fitted.theta, fitted.placement, kept)
    free = problem.free(kept)
    parts = [_Part.of(problem, kind, free, kind.metres / weight_of(kind, fitting.weights)) for kind in kinds]
    at, sigma = kinds.index(reference), 1.0 / np.array([part.scale for part in parts])
    for _ in range(STEPS if problem.reduced is None else 1):
        squares, redundancy = _residuals(parts, sigma, priors.rows[:, free], priors.rhs)
        common = np.sqrt(max(squares[at] / max(redundancy[at], 1.0), STEP_TOLERANCE**2))
        before, sigma = sigma, np.array([_noise(s, r, common) for s, r in zip(squares, redundancy, strict=True)])
        sigma[at] = common
        sigma, change = sigma / common, sigma / common / before
        if np.abs(np.log(change)).max() < SETTLED:
            break
    return {**fitting.weights, **{kind.name: kind.metres / s for kind, s in zip(kinds, sigma.tolist(), strict=True)}}


@dataclass(frozen=True)
class _Part:
    """Residual and columns of one kind of measurement, m. scale: length of its unit over that in the linear problem.

    pose: pose of each row. count: number of measurements, less those that unmeasured joints absorb.
    gram, pull: products of the columns with the columns and with the residual.
    """

    residual: Array
    columns: Array
    pose: IntArray
    count: float
    scale: float
    gram: Array
    pull: Array

    @classmethod
    def of(cls, problem: Linearised, kind: Observation, free: Mask, scale: float) -> "_Part":
        """Return the part of a linear problem that belongs to a kind of measurement."""
        of_kind = problem.observed.rows(kind)
        if problem.reduced is None:
            pose, component = np.nonzero(problem.weights > 0)
            chosen = (component >= of_kind.start) & (component < of_kind.stop)
            residual, columns, pose = problem.residual[chosen], problem.columns[chosen][:, free], pose[chosen]
            count = float(len(pose))
        else:
            left = problem.reduced.complement
            measured = problem.reduced.weights[:, of_kind] > 0
            pose = np.nonzero(measured)[0]
            residual, columns = (
                left.components(values)[:, of_kind][measured] for values in (problem.residual, problem.columns[:, free])
            )
            count = float(np.sum(left.shares[:, of_kind][measured]))
        residual, columns = scale * residual, scale * columns
        return cls(residual, columns, pose, count, scale, columns.T @ columns, columns.T @ residual)


def _residuals(parts: Sequence[_Part], sigma: Array, priors: Array, rhs: Array) -> tuple[Array, Array]:
    """Return sum of squares and redundancy of each kind after a least-squares step with noise `sigma` of the kinds.

    Rows beyond the outlier limit of their kind are omitted from the sum and from the number of measurements.
    """
    normal = sum((part.gram / s**2 for part, s in zip(parts, sigma, strict=True)), priors.T @ priors)
    right = sum((part.pull / s**2 for part, s in zip(parts, sigma, strict=True)), priors.T @ rhs)
    size = np.sqrt(np.diag(normal))
    size[size < ident.NEGLIGIBLE] = 1.0
    inverse = linalg.pinvh(normal / np.outer(size, size)) / np.outer(size, size)
    step = inverse @ right
    squares, redundancy = np.zeros(len(parts)), np.zeros(len(parts))
    for k, (part, s) in enumerate(zip(parts, sigma, strict=True)):
        left = (part.residual - part.columns @ step) ** 2
        by_pose = np.sqrt(np.bincount(part.pose, left))[part.pose]
        used = by_pose <= outlier_limit(by_pose[np.unique(part.pose, return_index=True)[1]])
        squares[k] = left[used].sum()
        redundancy[k] = part.count * used.mean() - np.sum(inverse * part.gram) / s**2
    return squares, redundancy


def _noise(squares: float, redundancy: float, common: float) -> float:
    """Return the most probable noise of a kind, m, by its residuals and by the noise of the reference kind."""

    def slope(log: float) -> float:
        return float(log / LOG_SPREAD**2 + free - least / common**2 * np.exp(-2.0 * log))

    free = max(redundancy, 0.0)
    least = squares + (free + 1.0) * STEP_TOLERANCE**2
    return common * float(np.exp(optimize.brentq(slope, -LARGEST_LOG, LARGEST_LOG)))
