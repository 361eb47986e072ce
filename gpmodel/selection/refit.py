"""The exact chain with what was selected: a damped fit with the learned variances as priors, and who stands far out."""

from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.iterate import Fitting, iterate
from gpmodel.calibration.linear_step import linear_step
from gpmodel.calibration.linearise import Linearised
from gpmodel.model.error_model import ErrorModel, Placement, Poses, pose_error
from gpmodel.numerics.least_squares import inverse_gram
from gpmodel.numerics.outliers import OUTLIER_SHARE, outlier_limit


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
    """The fit at a point. problem: its rows independent. covariance: posterior (E, E) of the values. sigma: of one
    measurement, m. unknowns: how many the measurements determine. error: (N,) m."""

    point: Expansion
    problem: Linearised
    covariance: Array
    sigma: float
    unknowns: float
    error: Array


def refit(point: Expansion, poses: Poses, bundle: IntArray, sigma: float) -> Refit:
    """Solve all values and the placement on the exact chain: θ ~ N(0, prior²), noise σ and the point's ratio.

    By the damped steps of a calibration: none is taken that does not lower the sum of squares, priors included.
    """
    inflation = 1.0 + point.ratio
    model = replace(point.model, noise=sigma * float(np.sqrt(inflation)))
    fitting = Fitting(model, poses, point.use, point.rotation_weight, bundle, point.ratio)
    everything = np.ones(len(model.effects), dtype=bool)
    fitted = iterate(fitting, point.theta, point.placement, everything)
    problem = fitting.at(fitted.theta, fitted.placement)
    linear = linear_step(model, problem, fitted.theta, fitted.placement, everything, None)
    inverse = inverse_gram(np.vstack([problem.columns / linear.scale, linear.priors]), many=True)
    unknowns = len(inverse) - float(np.sum((linear.priors @ inverse) * linear.priors))
    variance = float(problem.residual @ problem.residual) / max(len(problem.residual) - unknowns, 1.0)
    covariance = variance * inverse / np.outer(linear.scale, linear.scale)
    kept = slice(problem.placement, None)
    return Refit(
        point=replace(point, theta=fitted.theta, placement=fitted.placement),
        problem=problem,
        covariance=covariance[kept, kept],
        sigma=float(np.sqrt(variance / inflation)),
        unknowns=unknowns,
        error=pose_error(problem.observed, poses.dataset),
    )


def far_out(error: Array, use: Mask, sigmas: float) -> Mask:
    """The poses (N,) in use, judged anew: within so many robust deviations of the median error, at most a tenth left
    out."""
    far = error > outlier_limit(error[use], sigmas)
    worst = np.argsort(error)[::-1][: max(1, int(OUTLIER_SHARE * len(error)))]
    return ~(far & np.isin(np.arange(len(error)), worst))
