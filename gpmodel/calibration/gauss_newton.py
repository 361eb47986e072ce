"""Calibration: registration, tool, anchors and every effect solved together."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.linearise import Linearised, linearise, placement_after
from gpmodel.calibration.start import start_placement
from gpmodel.calibration.unmeasured_joints import check_points, free_joints, solve_joints
from gpmodel.errors import InputError
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, observe, pose_error
from gpmodel.numerics import rank as ident
from gpmodel.numerics.least_squares import MANY_COLUMNS, inverse_gram, solve
from gpmodel.table.split import folds

ROTATION_LEVER = 0.3
MAX_ITERATIONS = 30
STEP_TOLERANCE = 1e-9
OUTLIER_SIGMAS = 6.0
OUTLIER_SHARE = 0.1
MINIMUM_SHARE = 1e-3
FREE_JOINTS_LIMIT = 50.0


@dataclass(frozen=True)
class Calibration:
    """The fitted numbers and what is needed to distrust them.

    theta: (E,) values of model.effects, zero where dropped. stderr: (E,), NaN where dropped. kept: (E,) bool.
    correlation: (E, E). unique_share: (E,). sigma: m, one component. error: (N,) 3-D error of each pose, m.
    outliers: indices of poses left out of the fit. status: converged, stalled or diverged; reason says why.
    """

    model: ErrorModel
    placement: Placement
    theta: Array
    stderr: Array
    kept: Mask
    correlation: Array
    unique_share: Array
    sigma: float
    error: Array
    outliers: IntArray
    rank: int
    condition_limit: float
    rank_curve: tuple[ident.RankChoice, ...]
    lever: float
    iterations: int
    status: str
    reason: str

    @property
    def dropped(self) -> tuple[str, ...]:
        return tuple(e.name for e, k in zip(self.model.effects, self.kept, strict=True) if not k)

    def partners(self, limit: float = 0.8) -> Mapping[str, tuple[tuple[str, float], ...]]:
        """Effects correlated above `limit` in absolute value with each kept effect."""
        names = [e.name for e in self.model.effects]
        out = {}
        for i in np.flatnonzero(self.kept):
            near = [j for j in np.flatnonzero(self.kept) if j != i and abs(self.correlation[i, j]) > limit]
            out[names[i]] = tuple((names[j], float(self.correlation[i, j])) for j in near)
        return out


def errors_on(calibration: Calibration, poses: Poses) -> Array:
    """3-D error (N,) of a fitted model on any poses of known setups and tools, m; free joints are solved first."""
    poses = resolved(calibration, poses)
    observed = observe(calibration.model, poses, calibration.theta, calibration.placement)
    return pose_error(observed, poses.dataset)


def resolved(calibration: Calibration, poses: Poses) -> Poses:
    """The poses with the free joints of the mechanism solved against what was measured; the same without any."""
    return solve_joints(calibration.model, poses, calibration.theta, calibration.placement)


def calibrate(
    model: ErrorModel,
    poses: Poses,
    *,
    condition_limit: float | None = None,
    start: Calibration | None = None,
    robust: bool = True,
    seed: int = 0,
) -> Calibration:
    """Fit every parameter by Gauss-Newton on the analytic columns.

    condition_limit: constant effects whose share is under 1 / limit are dropped and named; None chooses it by
    cross-validation over identifiability.LIMITS. start: a calibration to go on from (its placement, the values of
    effects of the same name). Raises InputError with fewer observations than unknowns or poses all alike.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        return _calibrate(model, poses, condition_limit, start, robust, seed)


def _calibrate(
    model: ErrorModel,
    poses: Poses,
    condition_limit: float | None,
    start: Calibration | None,
    robust: bool,
    seed: int,
) -> Calibration:
    if free_joints(model.mechanism):
        check_points(poses.dataset)
        condition_limit = condition_limit or FREE_JOINTS_LIMIT
    placement = start.placement if start else start_placement(poses)
    lever = start.lever if start else ROTATION_LEVER
    use = np.ones(len(poses), dtype=bool)
    if start is not None and robust and len(start.error) == len(poses):
        use[start.outliers] = False
    before = dict(zip((e.name for e in start.model.effects), start.theta, strict=True)) if start else {}
    theta = np.array([before.get(e.name, 0.0) for e in model.effects])
    bare = ErrorModel(model.mechanism, ())
    iterations = 0
    if start is None:
        placement, _, _, iterations, _ = _iterate(bare, poses, np.zeros(0), placement, lever, use, np.zeros(0, bool))
    curve: tuple[ident.RankChoice, ...] = ()
    kept = np.zeros(len(theta), dtype=bool)
    status, limit = "converged", condition_limit or 1e4
    problem = linearise(model, poses, theta, placement, lever, use)
    for attempt in range(4):
        kept, limit, curve = _choose(model, poses, problem, condition_limit, seed)
        theta = np.where(kept, theta, 0.0)
        placement, theta, problem, used, status = _iterate(model, poses, theta, placement, lever, use, kept)
        iterations += used
        again = robust and _mark_outliers(poses, problem, use)
        if poses.dataset.has_rotation and attempt == 0 and start is None:
            lever, again = _lever(problem, poses), True
        if not again or status != "converged":
            break
        problem = linearise(model, poses, theta, placement, lever, use)
    return _summarise(model, poses, problem, placement, theta, kept, use, limit, curve, lever, iterations, status)


def _choose(
    model: ErrorModel, poses: Poses, problem: Linearised, condition_limit: float | None, seed: int
) -> tuple[Mask, float, tuple[ident.RankChoice, ...]]:
    """Which effects the poses can tell apart: constants by the condition limit, the others by unique share."""
    constant = np.array([e.constant for e in model.effects], dtype=bool)
    fixed, columns = problem.columns[:, : problem.placement], problem.columns[:, problem.placement :]
    ranking = ident.rank(fixed, columns[:, constant])
    curve: tuple[ident.RankChoice, ...] = ()
    limit = condition_limit or 1e4
    if condition_limit is None and constant.any():
        fold = folds(poses.dataset, 5, np.random.default_rng(seed))[problem.pose_of_row]
        curve = ident.rank_curve(fixed, columns[:, constant], ranking, problem.residual, fold)
        limit = min(curve, key=lambda c: c.cv_rms).condition_limit
    kept = np.zeros(len(model.effects), dtype=bool)
    kept[np.flatnonzero(constant)[ranking.kept(limit)]] = True
    believed = np.array([np.isfinite(e.prior) for e in model.effects], dtype=bool)
    varying = np.flatnonzero(~constant & ~believed)
    late = ident.rank(np.hstack([fixed, columns[:, kept]]), columns[:, varying])
    kept[varying[late.kept(1.0 / MINIMUM_SHARE)]] = True
    kept |= believed
    unknowns = ident.orthonormal(fixed).shape[1] if problem.left else problem.placement
    if len(problem.residual) < unknowns + (kept & ~believed).sum() + (problem.left is None):
        raise InputError(
            f"{poses.dataset.source}: {len(problem.residual)} measured values for "
            f"{unknowns + kept.sum()} unknowns; expected more poses than that or fewer parameters"
        )
    return kept, limit, curve


def _iterate(
    model: ErrorModel, poses: Poses, theta: Array, placement: Placement, lever: float, use: Mask, kept: Mask
) -> tuple[Placement, Array, Linearised, int, str]:
    last = np.inf
    problem = linearise(model, poses, theta, placement, lever, use)
    for iteration in range(1, MAX_ITERATIONS + 1):
        free = np.concatenate([np.ones(problem.placement, dtype=bool), kept])
        columns = problem.columns[:, free]
        belief, pull = beliefs(model, theta, problem, kept)
        system = np.vstack([columns, belief[:, free]])
        scale = np.hypot(problem.sizes[free], np.linalg.norm(belief[:, free], axis=0))
        scale[scale < ident.NEGLIGIBLE] = np.inf
        target = np.concatenate([problem.residual, pull])
        solution = solve(system / scale, target) / scale
        moved = float(np.max(np.abs(columns @ solution), initial=0.0))
        step = np.zeros(len(free))
        step[free] = solution
        placement = placement_after(poses, problem.observed, placement, step[: problem.placement])
        theta = theta + step[problem.placement :]
        problem = linearise(model, poses, theta, placement, lever, use)
        if moved < STEP_TOLERANCE:
            return placement, theta, problem, iteration, "converged"
        if not np.isfinite(moved) or moved > 1e3 * max(last, 1.0):
            return placement, theta, problem, iteration, "diverged"
        last = moved
    return placement, theta, problem, MAX_ITERATIONS, "stalled"


def beliefs(model: ErrorModel, theta: Array, problem: Linearised, kept: Mask) -> tuple[Array, Array]:
    """Rows of the priors, θ σ / prior = 0, one a kept effect that has one; σ from the residual itself."""
    prior = np.array([e.prior for e in model.effects])
    at = np.flatnonzero(kept & np.isfinite(prior))
    sigma = float(np.sqrt(np.mean(problem.residual**2)))
    rows = np.zeros((len(at), problem.columns.shape[1]))
    rows[np.arange(len(at)), problem.placement + at] = sigma / prior[at]
    return rows, -theta[at] * sigma / prior[at]


def _mark_outliers(poses: Poses, problem: Linearised, use: Mask) -> bool:
    """Take poses far outside the robust spread of the errors out of `use`; True when any was."""
    error = pose_error(problem.observed, poses.dataset)
    inside = error[use]
    spread = 1.4826 * np.median(np.abs(inside - np.median(inside)))
    far = use & (error > np.median(inside) + OUTLIER_SIGMAS * max(spread, 1e-9))
    worst = np.argsort(error)[::-1][: max(1, int(OUTLIER_SHARE * len(use))) - int((~use).sum())]
    far &= np.isin(np.arange(len(use)), worst)
    use[far] = False
    return bool(far.any())


def _lever(problem: Linearised, poses: Poses) -> float:
    """Metres a radian is worth: ratio of the robust spreads of position and rotation residuals."""
    residual = measured_minus(problem.observed, poses.dataset)
    position, rotation = np.nanmedian(np.abs(residual[:, :3])), np.nanmedian(np.abs(residual[:, 3:6]))
    return float(np.clip(position / rotation, 0.01, 10.0)) if position > 0 and rotation > 0 else ROTATION_LEVER


def _summarise(
    model: ErrorModel, poses: Poses, problem: Linearised, placement: Placement, theta: Array, kept: Mask,
    use: Mask, limit: float, curve: tuple[ident.RankChoice, ...], lever: float, iterations: int, status: str,
) -> Calibration:  # fmt: skip
    free = np.concatenate([np.ones(problem.placement, dtype=bool), kept])
    belief, _ = beliefs(model, theta, problem, kept)
    columns = np.vstack([problem.columns[:, free], belief[:, free]])
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale < ident.NEGLIGIBLE, 1.0, scale)
    many = columns.shape[1] >= MANY_COLUMNS
    inverse = inverse_gram(columns / scale, many)
    rank = columns.shape[1] if problem.left is None else int(np.linalg.matrix_rank(columns / scale, 1e-9))
    freedom = max(len(columns) - rank, 1)
    sigma = float(np.sqrt(np.sum(problem.residual**2) / freedom))
    covariance = sigma**2 * inverse / np.outer(scale, scale)
    effects = slice(problem.placement, None)
    deviation = np.sqrt(np.diag(covariance))
    safe = np.where(deviation > 0, deviation, 1.0)
    n, at = len(theta), np.flatnonzero(kept)
    stderr, share, correlation = np.full(n, np.nan), np.zeros(n), np.zeros((n, n))
    stderr[at] = deviation[effects]
    if many:
        share[at] = np.minimum(1.0, 1.0 / np.sqrt(np.diag(inverse)))[effects]
    else:
        fixed = ident.orthonormal(columns[:, : problem.placement])
        share[at] = ident.unique_shares(np.hstack([fixed, columns[:, effects]]))[fixed.shape[1] :]
    correlation[np.ix_(at, at)] = (covariance / np.outer(safe, safe))[effects, effects]
    reasons = {
        "converged": f"the last step moved no pose by more than {STEP_TOLERANCE * 1e6:g} µm",
        "stalled": f"still moving after {MAX_ITERATIONS} iterations: poses too alike, or joint values wrong",
        "diverged": "steps grew: wrong joint units, signs or order, or too few poses",
    }
    return Calibration(
        model=model, placement=placement, theta=theta, stderr=stderr, kept=kept, correlation=correlation,
        unique_share=share, sigma=sigma, error=pose_error(problem.observed, poses.dataset),
        outliers=np.flatnonzero(~use), rank=rank, condition_limit=limit, rank_curve=curve, lever=lever,
        iterations=iterations, status=status, reason=reasons[status],
    )  # fmt: skip


def without_outlier_marks(calibration: Calibration) -> Calibration:
    """The same fit, ready to judge every pose anew."""
    return replace(calibration, outliers=np.zeros(0, dtype=np.int64))
