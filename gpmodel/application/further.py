"""Errors at poses that were not fitted: bounds by simulation, errors of `predict` at held-out poses, discrepancy.

Simulations draw the model's parameters from their covariance, and noise with uncertain scale and tails, and with the
covariance of the coordinates.
Source: JCGM 101 (2008), propagation of distributions.

Model discrepancy is the error of a fitted model that is neither noise nor uncertainty of its parameters. With r
the residuals of a fit whose columns are C, and δ the error of the model's form,

    r = C θ + δ + e,   δ ~ N(0, γ n² K),   e ~ N(0, n² I)

K is the covariance of error twists, at every axis of the chain, that depend smoothly on the joint values. The part of
the residual that is smooth in the joint values is discrepancy; the rest is noise. The restricted likelihood of γ and n
does
not depend on θ. Sources: Kennedy and O'Hagan (2001), Bayesian calibration of computer models; Patterson and Thompson
(1971), recovery of inter-block information.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.application.exports.sample import at_joint_values
from gpmodel.application.kinematics import with_memory_columns
from gpmodel.application.model_file import SavedModel, saved_model
from gpmodel.application.predict import coordinate_deviations, observed_by, point_columns
from gpmodel.application.usable import usable
from gpmodel.arrays import Array, Count, IntArray, NotNegative
from gpmodel.calibration.comparison import HeldOutFit
from gpmodel.calibration.directions import LARGEST_LEVERAGE, as_measured
from gpmodel.calibration.linearise import Linearised, effect_columns
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.calibration.undeclared import has_functions
from gpmodel.discovery.state import Discovery
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import drawn_between
from gpmodel.model.error_model import Poses, closing, observe, pose_error, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import rank
from gpmodel.numerics.interval import COVERAGE, Tails, with_far_ones
from gpmodel.numerics.least_squares import outlier_limit
from gpmodel.table.blocks import sharing

POSES = 1000
"""Number of poses of each simulated session of further measurements."""
WORLDS = 400
"""Number of simulated sessions of further measurements. With 400 sessions the 95 % quantile is known to a percent."""
FEWEST = 10
"""Least degrees of freedom of residuals for error bounds, and to separate noise from model discrepancy."""


@dataclass(frozen=True)
class Bound:
    """Statistic of the errors at further poses, mm: median over simulations, and quantile at the confidence level."""

    typical_mm: NotNegative
    bound_mm: NotNegative


@dataclass(frozen=True)
class ErrorBounds:
    """Distance between measured and predicted point at `poses` further poses within the measured joint ranges.

    rms, within_95, largest: root mean square, 95th percentile and maximum of the distance. The confidence level holds
    for each bound separately.
    """

    poses: Count
    confidence: float
    rms: Bound
    within_95: Bound
    largest: Bound


def further_poses(fit: Calibration, poses: Poses, spread: float | None = None) -> ErrorBounds | None:
    """Bound the errors that a model fitted to `poses` has at further poses.

    No bound is computed if joint values are approximate, positions are incomplete, inputs from earlier rows are unknown
    at further poses, or the measurements hardly outnumber the unknowns.
    spread: standard deviation of one measured coordinate about the model, m, with its discrepancy; None: `fit.sigma`. A
    search for effects fits a part of the noise, so that residuals are too small by spread / fit.sigma.
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
        known = with_memory_columns(saved, data)
    except InputError:
        return None
    (inside, blur), (outside, around) = (leave_one_out(fit, problem, rows) for rows in (use, far))
    root = np.asarray(np.linalg.cholesky(np.eye(3) if fit.shape is None else fit.shape), dtype=np.float64)
    near, beyond = (errors @ np.asarray(np.linalg.inv(root).T, dtype=np.float64) for errors in (inside, outside))
    noise = with_far_ones(near, beyond, count, (blur, around))
    low, high = data.q[use].min(axis=0), data.q[use].max(axis=0)
    drawn = at_joint_values(known, drawn_between(saved.mechanism, low, high, POSES, rng), rng)
    there = prepare(saved.mechanism, drawn.subset(closing(fit.model, drawn, fit.theta)))
    observed = observe(fit.model, there, fit.theta, fit.placement)
    excess = 1.0 if spread is None else spread / fit.sigma
    columns = point_columns(saved, there, observed, fit.covariance.alternatives)
    return _over_worlds(columns, fit.covariance.predictive, noise, excess * root, rng)


def _coordinates(fit: Calibration, problem: Linearised, use: IntArray) -> float:
    """Return the degrees of freedom of rows: effective number of independent coordinates minus number of unknowns."""
    fitted = problem.weights[use] > 0
    return float(fit.freedom * fitted[:, :3].sum() / max(fitted.sum(), 1))


def leave_one_out(fit: Calibration, problem: Linearised, use: IntArray) -> tuple[Array, Array]:
    """Compute the leave-one-out residuals (rows, 3), m, of the rows `use`: r / (1 - h) with leverage h.

    Also return the variance of the prediction of each row in units of the noise variance: h / (1 - h). The leverage of
    a row is the mean of its measured coordinates; the residual of an unmeasured coordinate is NaN.
    """
    at = problem.weights[:, :3] > 0
    rows = np.full(at.shape, -1)
    rows[at] = np.cumsum(problem.weights.ravel() > 0).reshape(problem.weights.shape)[:, :3][at] - 1
    own = rows[use]
    there = own >= 0
    columns = problem.columns[own[there]]
    shares = np.zeros(own.shape)
    shares[there] = np.sum((columns @ fit.covariance.values) * columns, axis=1) / fit.sigma**2
    known = shares.sum(axis=1) / np.maximum(there.sum(axis=1), 1)
    fitted = np.isin(use, fit.outliers, invert=True)
    left = np.where(fitted, 1.0 - np.minimum(known, LARGEST_LEVERAGE), 1.0)
    rows = as_measured(problem, np.where(at, problem.residual[rows], 0.0))[use]
    return np.where(there, rows, np.nan) / left[:, None], known / left


def _over_worlds(columns: Array, covariance: Array, noise: Tails, root: Array, rng: np.random.Generator) -> ErrorBounds:
    """Return bounds on the error at further poses by simulation.

    columns: derivatives of the predicted points with respect to the unknowns. covariance: covariance of the unknowns.
    root: (3, 3) matrix that turns independent errors of `noise` into errors of the coordinates of a position.
    """
    spread = rank.square_root(covariance)
    drawn = spread @ rng.normal(size=(len(spread), WORLDS))
    off = np.moveaxis(columns @ drawn, 2, 0) + noise.drawn((WORLDS, len(columns), 3), rng) @ root.T
    distance = np.linalg.norm(off, axis=2)
    rms, within = np.sqrt(np.mean(distance**2, axis=1)), np.percentile(distance, 95, axis=1)
    return ErrorBounds(len(columns), COVERAGE, _bound(rms), _bound(within), _bound(distance.max(axis=1)))


def _bound(worlds: Array) -> Bound:
    return Bound(1e3 * float(np.median(worlds)), 1e3 * float(np.quantile(worlds, COVERAGE)))


def saved_step(found: Discovery) -> int:
    """Return the number of the saved model: the last model if held-out poses confirm it, else the standard model."""
    return len(found.steps) - 1 if found.confirmed else 1


def heldout_fits(found: Discovery) -> tuple[HeldOutFit, ...]:
    """Return the fits of the saved model with their held-out poses: one fit per fold, or a single fit."""
    number = saved_step(found)
    return tuple(
        HeldOutFit(part.step(number).calibration, part.poses.subset(part.train), part.poses.subset(part.heldout))
        for part in found.parts or (found,)
        if len(part.heldout)
    )


def predicted_errors(saved: SavedModel, poses: Poses, *, as_measured: bool) -> Array:
    """Return the 3-D error of a model at each measured pose, m, predicted as by `predict`.

    as_measured: True to include the errors of the instrument and of the session, as for rows of the fitted session.
    """
    return pose_error(observed_by(usable(saved, session=as_measured), poses)[1], poses.dataset, saved.weights)


def heldout_errors(poses: Poses, parts: Sequence[HeldOutFit], *, as_measured: bool) -> Array:
    """Return the 3-D error of every pose, m, by the fit that held the pose out; NaN if every fit used the pose."""
    out = np.full(len(poses), np.nan)
    for part in parts:
        asked = part.known
        if len(asked):
            at = np.isin(poses.dataset.row, asked.dataset.row)
            out[at] = predicted_errors(saved_model(part.fit, part.train), asked, as_measured=as_measured)
    return out


def with_discrepancy(
    saved: SavedModel, fit: Calibration, poses: Poses, parts: Sequence[HeldOutFit] = (), noise: float | None = None
) -> SavedModel:
    """Add noise and model discrepancy of one coordinate, m, to a model fitted to `poses`.

        discrepancy² = max(0, mean square held-out error - noise² - variance by parameters and other causes)

    parts: fits with held-out poses; without such fits, each pose is left out in turn. noise: stated standard deviation
    of a coordinate, m; None for that of the instrument's specification or, without a specification, `noise_within`.
    Only measured coordinates count. A model with functions of undeclared effects contains its discrepancy.
    """
    if poses.dataset.joints_approximate or has_functions(fit.model) or not len(_measured(poses)):
        return saved
    stated = poses.dataset.instrument
    if noise is None:
        noise = noise_within(fit, poses) if stated is None else stated.noise(poses.dataset.position)
    found = [_by_parameters(part) for part in parts]
    if sum(np.isfinite(squares).sum() for squares, _ in found) < FEWEST:
        found = [_one_left_out(fit, poses)]
    squares, known = (np.concatenate(values) for values in zip(*found, strict=True))
    error, read = np.sqrt(np.nansum(squares, axis=1)), np.isfinite(squares)
    if read.sum() < FEWEST:
        return replace(saved, noise=noise)
    near = read & (error <= outlier_limit(error))[:, None]
    variance = float(np.mean(squares[near]) - noise**2 - np.mean(known[near])) - _by_other_causes(saved, poses)
    return replace(saved, noise=noise, discrepancy=float(np.sqrt(max(0.0, variance))))


def _by_other_causes(saved: SavedModel, poses: Poses) -> float:
    """Return the mean variance of a measured coordinate due to alternative causes of the findings, m²."""
    if not len(saved.covariance.over_causes):
        return 0.0
    alone = replace(saved, covariance=replace(saved.covariance, alternatives=(), over_causes=np.zeros((0, 0))))
    at, observed = observed_by(saved, poses)
    read = np.isfinite(poses.dataset.position)
    both, one = (np.mean(coordinate_deviations(model, at, observed)[read] ** 2) for model in (saved, alone))
    return float(both - one)


def _measured(poses: Poses) -> IntArray:
    """Return the rows with a measured coordinate."""
    return np.flatnonzero(np.isfinite(poses.dataset.position).any(axis=1))


def _by_parameters(part: HeldOutFit) -> tuple[Array, Array]:
    """Return the squared errors of held-out coordinates, and the variance due to the parameters, both m²."""
    asked = part.known
    asked = asked.subset(_measured(asked))
    if not len(asked):
        return np.zeros((0, 3)), np.zeros((0, 3))
    saved = usable(saved_model(part.fit, part.train), session=True)
    poses, observed = observed_by(saved, asked)
    left = poses.dataset.position - observed.tip[:, :3, 3]
    return left**2, coordinate_deviations(saved, poses, observed) ** 2


def _one_left_out(fit: Calibration, poses: Poses) -> tuple[Array, Array]:
    """Return squared leave-one-out errors and prediction variances of every fitted pose, m²."""
    rows = np.setdiff1d(_measured(poses), fit.outliers)
    if fit.freedom < FEWEST:
        return np.zeros((0, 3)), np.zeros((0, 3))
    left, blur = leave_one_out(fit, problem_at(fit, poses), rows)
    return left**2, np.repeat(fit.sigma**2 * blur[:, None], 3, axis=1)


MOST_POSES = 200
"""Number of poses, evenly spaced along the rows, from which noise and discrepancy are estimated. With 600 coordinates
the noise is known to 3 %."""
LENGTHS = (0.3, 0.08)
"""Correlation lengths of the model discrepancy, as shares of a joint's range: one period over the range, and four."""
ORDER = 4
"""Largest number of joints in a term of the model discrepancy. With two joints per term, one more simulated robot in a
hundred has an error above two standard deviations."""
RATIOS = np.concatenate([[0.0], np.geomspace(1e-2, 1e3, 41)])
"""Grid of γ, the variance ratio of model discrepancy and noise. Below 0.01 discrepancy changes no standard error."""


def noise_within(fit: Calibration, poses: Poses) -> float:
    """Estimate the noise of one coordinate without model discrepancy, a standard deviation, m; at most `fit.sigma`.

    The estimated variance is an average of the variance without discrepancy and the variances at the most likely γ of
    each covariance K, with Akaike weights (one nat per unknown). Source: Burnham and Anderson (2002), 2.9.
    """
    rows = _independent(fit, poses)
    if poses.dataset.joints_approximate or not len(rows):
        return fit.sigma
    ours = poses.subset(rows)
    problem = problem_at(fit, ours)
    if problem.reduced is not None:
        return fit.sigma
    point = np.nonzero(problem.weights > 0)[1] < 3
    fitted = rank.orthonormal(problem.columns[point][:, problem.free(fit.free)])
    rest = np.linalg.qr(fitted, mode="complete")[0][:, fitted.shape[1] :]
    if rest.shape[1] < FEWEST:
        return fit.sigma
    found = [_restricted(rest, kernel, problem.residual[point]) for kernel in _kernels(fit, ours, problem)]
    shares, odds = np.array([(1.0, 1.0), *found]).T
    return float(fit.sigma * np.sqrt(min(1.0, shares @ odds / odds.sum())))


def _restricted(rest: Array, kernel: Array, residual: Array) -> tuple[float, float]:
    """Return the ratio of the noise variances at the most likely γ and at γ = 0, and the odds of these two.

    rest: orthonormal basis of the residual space of a fit. kernel: correlation matrix of the discrepancy, of mean
    variance one. residual: residual of the fit. γ: variance of the discrepancy over the variance of the noise."""
    values, vectors = np.linalg.eigh(rest.T @ kernel @ rest)
    squares = (vectors.T @ (rest.T @ residual)) ** 2
    scaled = 1.0 + RATIOS[:, None] * np.maximum(values, 0.0)
    variance = np.mean(squares / scaled, axis=1) + np.finfo(float).tiny
    likelihood = -0.5 * (len(squares) * np.log(variance) + np.log(scaled).sum(axis=1))
    best = int(np.argmax(likelihood))
    return float(variance[best] / variance[0]), float(np.exp(min(likelihood[best] - likelihood[0] - 1.0, 600.0)))


def _independent(fit: Calibration, poses: Poses) -> IntArray:
    """Return the row numbers of fitted positions, one per repeated pose, at most 200 (MOST_POSES)."""
    use = np.setdiff1d(_measured(poses), fit.outliers)
    first = np.sort(np.unique(sharing(poses.dataset)[use], return_index=True)[1])
    chosen: IntArray = use[first[np.linspace(0, len(first) - 1, min(len(first), MOST_POSES)).astype(int)]]
    return chosen


def _kernels(fit: Calibration, poses: Poses, problem: Linearised) -> Iterator[Array]:
    """Yield covariances of model discrepancy of measured coordinates, of mean variance 1: by joint values, then others.

    A covariance is Σ c cᵀ over axes (c: displacement by an error twist), each block times the correlation of two poses.
    Further covariances add payload, row and other columns, one at a time."""
    effects = geometric_effects(fit.model.mechanism)
    read = problem.weights[:, :3] > 0
    columns = problem.weigh(effect_columns(effects, fit.model, poses, problem.observed))
    columns = columns[np.nonzero(problem.weights > 0)[1] < 3]
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    data = poses.dataset
    further = [np.asarray(v, dtype=float) for v in (data.payload, data.row, *data.extras.values()) if np.ptp(v) > 0]
    smooth = [joint_correlation(data.q), *(joint_correlation(v[:, None], order=1) for v in further)]
    products = columns @ columns.T
    for correlation in (smooth[0], np.sum(smooth, axis=0)):
        kernel = products * correlation[np.ix_(*2 * [np.nonzero(read)[0]])]
        yield np.asarray(kernel * len(kernel) / np.trace(kernel))


def joint_correlation(q: Array, lengths: Sequence[float] = LENGTHS, order: int = ORDER) -> Array:
    """Return the correlation of an unknown function of the joint values q at every two poses.

    The correlation is the mean over joints of exp(-d²/2), and its powers up to `order` (products of joints), with the
    distance d in correlation lengths. lengths: correlation lengths as shares of a joint's range.
    """
    span = np.ptp(q, axis=0)
    gaps = (q[:, None] - q[None])[:, :, span > 0] / span[span > 0]
    near = np.mean([np.exp(-0.5 * (gaps / length) ** 2).mean(axis=2) for length in lengths], axis=0)
    return np.asarray(np.mean([near**power for power in range(1, order + 1)], axis=0))
