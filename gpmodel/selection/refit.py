"""The exact chain with what was selected: Gauss-Newton with the learned variances as priors, and who stands far out."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised, linearise, placement_after
from gpmodel.calibration.noise import Whitening, blocks_of
from gpmodel.model.error_model import ErrorModel, Placement, Poses, pose_error
from gpmodel.numerics.outliers import OUTLIER_SHARE, outlier_limit

ITERATIONS = 12
"""Steps at most; two or three are usual from the linear solution."""
SETTLED = 1e-8
"""Metres: a step that moves no reading by more ends them; instruments resolve a hundred times that."""
RIDGE = 1e-12
"""Relative, against rounding in what the priors do not hold."""


@dataclass(frozen=True)
class Expansion:
    """Where the chain is linearised: effects with priors and their values (E,), placement, and the poses in use (N,).

    ratio: variance of what a pose repeats over that of a measurement.
    """

    model: ErrorModel
    theta: Array
    placement: Placement
    rotation_weight: float
    use: Mask
    ratio: float = 0.0


@dataclass(frozen=True)
class Refit:
    """The fit at a point. covariance: posterior (E, E) of the values. sigma: of one measurement, m. error: (N,) m."""

    point: Expansion
    problem: Linearised
    whitening: Whitening
    covariance: Array
    sigma: float
    unknowns: float
    error: Array


def whitened(problem: Linearised, bundle: IntArray, ratio: float) -> Whitening:
    """The noise of the rows of a problem, of a known ratio between its two levels."""
    return replace(blocks_of(problem, bundle), ratio=ratio)


@dataclass(frozen=True)
class Normal:
    """Whitened columns (M, K) and prior rows, scaled to unit length together, of θ ~ N(0, prior²) and noise σ.

    pull: (K,) σ / prior over the scale, zero for the placement. inner: (K, K) normal matrix.
    """

    columns: Array
    scale: Array
    pull: Array
    inner: Array


def normal(problem: Linearised, noise: Whitening, prior: Array, sigma: float) -> Normal:
    """The normal equations of a problem under priors (E,) of its effects, whitened, columns scaled to one."""
    pull = np.concatenate([np.zeros(problem.placement), sigma / prior])
    columns = noise.whiten(problem.columns)
    scale = np.hypot(np.linalg.norm(columns, axis=0), pull)
    scale = np.where(scale > 0, scale, 1.0)
    columns, pull = columns / scale, pull / scale
    inner = columns.T @ columns
    inner[np.diag_indices_from(inner)] += pull**2 + RIDGE
    return Normal(columns, scale, pull, inner)


def refit(point: Expansion, poses: Poses, bundle: IntArray, sigma: float) -> Refit:
    """Solve all values and the placement on the exact chain: θ ~ N(0, prior²), noise σ and the point's ratio."""
    prior = np.array([e.prior for e in point.model.effects])
    theta, placement, before = point.theta.copy(), point.placement, np.inf
    for _ in range(ITERATIONS):
        problem = linearise(point.model, poses, theta, placement, point.rotation_weight, point.use)
        noise = whitened(problem, bundle, point.ratio)
        system = normal(problem, noise, prior, sigma)
        right = system.columns.T @ noise.whiten(problem.residual)
        right[problem.placement :] -= system.pull[problem.placement :] * (sigma / prior) * theta
        step = linalg.solve(system.inner, right, assume_a="pos", check_finite=False)
        moved = float(np.max(np.abs(system.columns @ step), initial=0.0))
        if not np.isfinite(moved) or moved > 10 * before:
            break
        step = step / system.scale
        placement = placement_after(poses, problem.observed, placement, step[: problem.placement])
        theta, before = theta + step[problem.placement :], moved
        if moved < SETTLED:
            break
    return _summary(replace(point, theta=theta, placement=placement), poses, bundle, sigma)


def _summary(point: Expansion, poses: Poses, bundle: IntArray, sigma: float) -> Refit:
    problem = linearise(point.model, poses, point.theta, point.placement, point.rotation_weight, point.use)
    noise = whitened(problem, bundle, point.ratio)
    system = normal(problem, noise, np.array([e.prior for e in point.model.effects]), sigma)
    residual = noise.whiten(problem.residual)
    inverse = linalg.inv(system.inner, check_finite=False)
    unknowns = float(len(inverse) - np.sum(np.diag(inverse) * system.pull**2))
    found = float(np.sqrt(residual @ residual / max(len(residual) - unknowns, 1.0)))
    covariance = found**2 * inverse / np.outer(system.scale, system.scale)
    error = pose_error(problem.observed, poses.dataset)
    kept = slice(problem.placement, None)
    return Refit(point, problem, noise, covariance[kept, kept], found, unknowns, error)


def far_out(error: Array, use: Mask) -> Mask:
    """The poses (N,) in use, judged anew: within 6 robust deviations of the median error, at most a tenth left out."""
    far = error > outlier_limit(error[use])
    worst = np.argsort(error)[::-1][: max(1, int(OUTLIER_SHARE * len(error)))]
    return ~(far & np.isin(np.arange(len(error)), worst))
