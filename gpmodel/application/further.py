"""Bounds of the error at further poses, by a Monte Carlo simulation over all fitted quantities.

Each simulation draws the model's parameters from their covariance, and the noise with uncertain scale and tails.
Source: JCGM 101 (2008), propagation of distributions.
"""

from dataclasses import dataclass

import numpy as np

from gpmodel.application.exports.sample import at_joint_values
from gpmodel.application.kinematics import remembered
from gpmodel.application.model_file import saved_model
from gpmodel.application.predict import point_columns
from gpmodel.arrays import Array, Count, IntArray, NotNegative
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import drawn_between
from gpmodel.model.error_model import Poses, closing, observe, prepare
from gpmodel.numerics.interval import COVERAGE, Tails, with_far_ones

POSES = 1000
"""Poses of each simulated session."""
WORLDS = 400
"""Number of simulated sessions. With 400 the 95 % quantile is known to about a percent."""
LARGEST_LEVERAGE = 0.95
"""Largest leverage of a pose for its residual to count. With more, the pose fits itself and its residual is
rounding."""
FEWEST = 10
"""Least degrees of freedom of the residuals for a bound on further poses."""


@dataclass(frozen=True)
class Bound:
    """Statistic of further poses, mm: median over the simulations, and the value that 1 - confidence of them exceed."""

    typical_mm: NotNegative
    bound_mm: NotNegative


@dataclass(frozen=True)
class ErrorBounds:
    """Distance between measured and predicted point at `poses` further poses within the measured joint ranges.

    rms, within_95, largest: root mean square, 95th percentile and maximum. Each bound has the confidence by itself.
    """

    poses: Count
    confidence: float
    rms: Bound
    within_95: Bound
    largest: Bound


def further_poses(fit: Calibration, poses: Poses, spread: float | None = None) -> ErrorBounds | None:
    """Bound the errors of a model, fitted to `poses`, at further poses.

    None if joint values are approximate, positions are incomplete, columns of earlier rows are unknown there, or the
    measurements hardly outnumber the unknowns.
    spread: standard deviation of one measured coordinate about the model, m, with its discrepancy; None for
    `fit.sigma`. A search fits a part of the noise, so that its residuals are too small by spread / fit.sigma.
    """
    data = poses.dataset
    whole = np.flatnonzero(np.isfinite(data.position).all(axis=1))
    use, far = np.setdiff1d(whole, fit.outliers), np.intersect1d(whole, fit.outliers)
    if data.joints_approximate or data.observations:
        return None
    problem = problem_at(fit, poses)
    if (count := _coordinates(fit, problem, use)) < FEWEST:
        return None
    saved, rng = saved_model(fit, poses), np.random.default_rng(0)
    try:
        known = remembered(saved, data)
    except InputError:
        return None
    (inside, blur), (outside, around) = (left_out(fit, problem, rows) for rows in (use, far))
    noise = with_far_ones(inside, outside, count, (blur, around))
    low, high = data.q[use].min(axis=0), data.q[use].max(axis=0)
    drawn = at_joint_values(known, drawn_between(saved.mechanism, low, high, POSES, rng), rng)
    there = prepare(saved.mechanism, drawn.subset(closing(fit.model, drawn, fit.theta)))
    observed = observe(fit.model, there, fit.theta, fit.placement)
    excess = 1.0 if spread is None else spread / fit.sigma
    columns = point_columns(saved, there, observed, fit.covariance.others)
    return _over_worlds(columns, fit.covariance.predictive, noise, excess, rng)


def _coordinates(fit: Calibration, problem: Linearised, use: IntArray) -> float:
    """Return the effective number of independent coordinates of the rows `use`, minus the unknowns."""
    fitted = problem.weights[use] > 0
    return float(fit.freedom * fitted[:, :3].sum() / max(fitted.sum(), 1))


def left_out(fit: Calibration, problem: Linearised, use: IntArray) -> tuple[Array, Array]:
    """Return the residuals (M, 3), m, of the rows `use` by a fit to all others: r / (1 - h) with leverage h.

    Also return the variance (M,) of the prediction of each row in units of the noise's: h / (1 - h).
    """
    at = problem.weights[:, :3] > 0
    rows = np.full(at.shape, -1)
    rows[at] = np.cumsum(problem.weights.ravel() > 0).reshape(problem.weights.shape)[:, :3][at] - 1
    own = rows[use]
    columns = problem.columns[own.ravel()]
    known = np.sum((columns @ fit.covariance.values) * columns, axis=1).reshape(own.shape).mean(axis=1) / fit.sigma**2
    fitted = np.isin(use, fit.outliers, invert=True)
    left = np.where(fitted, 1.0 - np.minimum(known, LARGEST_LEVERAGE), 1.0)
    return problem.residual[own] / left[:, None], known / left


def _over_worlds(
    columns: Array, covariance: Array, noise: Tails, excess: float, rng: np.random.Generator
) -> ErrorBounds:
    """Return bounds on the error by simulation.

    columns: derivatives (N, 3, K) of the predicted points by K unknowns. excess: factor on the noise.
    """
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = root @ rng.normal(size=(len(root), WORLDS))
    off = np.moveaxis(columns @ drawn, 2, 0) + excess * noise.drawn((WORLDS, len(columns), 3), rng)
    distance = np.linalg.norm(off, axis=2)
    rms, within = np.sqrt(np.mean(distance**2, axis=1)), np.percentile(distance, 95, axis=1)
    return ErrorBounds(len(columns), COVERAGE, _bound(rms), _bound(within), _bound(distance.max(axis=1)))


def _bound(worlds: Array) -> Bound:
    return Bound(1e3 * float(np.median(worlds)), 1e3 * float(np.quantile(worlds, COVERAGE)))
