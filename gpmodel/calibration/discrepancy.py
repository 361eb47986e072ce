"""Model discrepancy: the error of a fitted model that is neither noise nor uncertainty of its parameters.

With r (M,) the residuals of a fit whose columns are C, and δ the error of the model's form,

    r = C θ + δ + e,   δ ~ N(0, γ n² K),   e ~ N(0, n² I)

K is the covariance of twists at every axis of the chain that depend smoothly on the joint values. The part of the
residual that is smooth in the joint values is discrepancy; the rest is noise. The restricted likelihood of γ and n does
not depend on θ. Sources: Kennedy and O'Hagan (2001), Bayesian calibration of computer models; Patterson and Thompson
(1971), recovery of inter-block information.
"""

from collections.abc import Sequence

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import Linearised, effect_columns
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.model.error_model import Poses
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import rank
from gpmodel.table.bundles import sharing

MOST_POSES = 200
"""Poses from which noise and discrepancy are estimated, drawn evenly along the rows. Their 600 coordinates give the
noise to 3 %."""
FEWEST = 10
"""Least degrees of freedom for separating noise and discrepancy."""
LENGTHS = (0.3, 0.08)
"""Correlation lengths of the discrepancy, as shares of a joint's range: one period over the range, and four."""
ORDER = 4
"""Largest number of joints in a term of the discrepancy. With two, one more robot in a hundred lies outside
two sigma."""
RATIOS = np.concatenate([[0.0], np.geomspace(1e-2, 1e3, 41)])
"""Grid of γ. Below 0.01 the discrepancy is a tenth of the noise and changes no standard error."""


def noise_within(fit: Calibration, poses: Poses) -> float:
    """Estimate the standard deviation (m) of the noise of one coordinate without discrepancy; at most `fit.sigma`.

    Average of the variance without discrepancy and the variance at the most likely γ, by Akaike weights: one more
    unknown costs one nat. Source: Burnham and Anderson (2002), 2.9.
    """
    rows = _independent(fit, poses)
    if poses.dataset.joints_approximate or not len(rows):
        return fit.sigma
    ours = poses.subset(rows)
    problem = problem_at(fit, ours)
    if problem.left is not None:
        return fit.sigma
    point = np.nonzero(problem.weights > 0)[1] < 3
    fitted = rank.orthonormal(problem.columns[point][:, problem.free(fit.kept)])
    rest = np.linalg.qr(fitted, mode="complete")[0][:, fitted.shape[1] :]
    if rest.shape[1] < FEWEST:
        return fit.sigma
    variance, odds, best = _restricted(rest, _kernel(fit, ours, problem), problem.residual[point])
    share = variance[best] / variance[0]
    return float(fit.sigma * np.sqrt(min(1.0, (1.0 + odds * share) / (1.0 + odds))))


def _restricted(rest: Array, kernel: Array, residual: Array) -> tuple[Array, float, int]:
    """Return the noise variance at each of RATIOS, the odds of the most likely γ against zero, and its index.

    rest: (M, R) orthonormal basis of the residual space of a fit. kernel: (M, M) of mean variance one. residual: (M,).
    """
    values, vectors = np.linalg.eigh(rest.T @ kernel @ rest)
    squares = (vectors.T @ (rest.T @ residual)) ** 2
    scaled = 1.0 + RATIOS[:, None] * np.maximum(values, 0.0)
    variance = np.mean(squares / scaled, axis=1) + np.finfo(float).tiny
    likelihood = -0.5 * (len(squares) * np.log(variance) + np.log(scaled).sum(axis=1))
    best = int(np.argmax(likelihood))
    return variance, float(np.exp(min(likelihood[best] - likelihood[0] - 1.0, 700.0))), best


def _independent(fit: Calibration, poses: Poses) -> IntArray:
    """Return the indices (K,) of fitted poses with x, y and z, one per repeated pose; at most MOST_POSES."""
    whole = np.flatnonzero(np.isfinite(poses.dataset.position).all(axis=1))
    use = np.setdiff1d(whole, fit.outliers)
    first = np.sort(np.unique(sharing(poses.dataset)[use], return_index=True)[1])
    chosen: IntArray = use[first[np.linspace(0, len(first) - 1, min(len(first), MOST_POSES)).astype(int)]]
    return chosen


def _kernel(fit: Calibration, poses: Poses, problem: Linearised) -> Array:
    """Return K (3N, 3N) of mean variance one: Σ over axes of c cᵀ, each block times the correlation of two poses."""
    effects = geometric_effects(fit.model.mechanism)
    columns = effect_columns(effects, fit.model, poses, problem.observed)[:, :3].reshape(-1, len(effects))
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    kernel = (columns @ columns.T) * np.kron(alike(poses.dataset.q), np.ones((3, 3)))
    return np.asarray(kernel * len(kernel) / np.trace(kernel))


def alike(q: Array, lengths: Sequence[float] = LENGTHS, order: int = ORDER) -> Array:
    """Return the correlation (N, N) of an unknown function at two poses.

    Mean over joints of exp(-d²/2) and its powers up to `order`, which contain products of joints. lengths: as shares of
    a joint's range.
    """
    span = np.ptp(q, axis=0)
    gaps = (q[:, None] - q[None])[:, :, span > 0] / span[span > 0]
    near = np.mean([np.exp(-0.5 * (gaps / length) ** 2).mean(axis=2) for length in lengths], axis=0)
    return np.asarray(np.mean([near**power for power in range(1, order + 1)], axis=0))
