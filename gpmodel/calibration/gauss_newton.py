"""Calibrate: fit registration, tool, fixed ends of distances and all error terms together by Gauss-Newton."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg
from threadpoolctl import threadpool_limits

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.gauge import LARGEST_LIMIT, choose
from gpmodel.calibration.iterate import REASONS, Fitted, Fitting, iterate, linear_step
from gpmodel.calibration.kinds import estimated_weights
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.noise import pose_ratio
from gpmodel.calibration.priors import residual_sigma
from gpmodel.calibration.result import Calibration, uncertainty
from gpmodel.calibration.start import placement_after, start_placements
from gpmodel.calibration.unmeasured_joints import STARTING_WEIGHTS, check_points, free_joints
from gpmodel.model.effect import REGISTRATION, TOOL, Effect, TakenUp
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, pose_error
from gpmodel.model.observation import Weights, observations
from gpmodel.model.observed import Observed
from gpmodel.numerics.least_squares import among_worst, in_company, outlier_limit
from gpmodel.numerics.rank import LIMITS, RankChoice
from gpmodel.table.blocks import sharing
from gpmodel.table.dataset import Dataset

STEPS = 10
"""Largest number of Gauss-Newton steps that split errors of the instrument into rigid motion and distortion."""

SETTLED = 1e-8
"""Displacement by a step, m, at which the iterations end: a hundredth of an instrument's resolution."""

WEAKEST = 1e-3
"""Smallest singular value of the normalised columns of registration and tool that is used to absorb a residual. Along a
smaller singular value, a residual of a millimetre would move the tool by a metre."""


def with_taken_up(model: ErrorModel, known: ErrorModel) -> ErrorModel:
    """Return the model with the instrument's effects split into rigid motion and distortion as in a `known` model.

    With the columns D of the instrument's effects θ, the columns P of registrations and tools, and G = P⁺ D, the error
    D θ of the measurements is P G θ + (D - P G) θ. P G θ moves robot and tool rigidly; (D - P G) θ is distortion by the
    instrument. The measurements determine only the sum of rigid motion and distortion, so the split
    into the two parts is copied from the known model.
    """
    there = {(e.name, e.terms): e.taken_up for e in known.effects if e.taken_up}
    if not there:
        return model
    effects = tuple(replace(e, taken_up=there.get((e.name, e.terms), e.taken_up)) for e in model.effects)
    return replace(model, effects=effects)


def split(fitting: Fitting, fitted: Fitted, kept: Mask) -> tuple[Fitting, Fitted]:
    """Move the rigid part of instrument errors into registrations and tools; predictions do not change.

    kept: mask of the fitted effects of the model.
    """
    of_it = np.array([e.of_the_instrument for e in fitting.model.effects], dtype=bool)
    own = np.flatnonzero(of_it & kept & (fitted.theta != 0.0))
    if not len(own):
        return fitting, fitted
    theta, placement, problem, here = fitted.theta, fitted.placement, fitted.problem, fitting
    for _ in range(STEPS):
        rigid = np.flatnonzero(problem.rigid)
        moved, columns = _moved(here, problem, theta, placement, own), problem.columns[:, problem.placement + own]
        whole = _least(problem.columns[:, rigid], moved[:, None])[:, 0]
        if np.abs(problem.columns[:, rigid] @ whole).max(initial=0.0) < SETTLED:
            break
        shares = _least(problem.columns[:, rigid], columns)
        weight = np.maximum((theta[own] * np.linalg.norm(columns, axis=0)) ** 2, np.finfo(float).tiny)
        shares += np.outer(whole - shares @ theta[own], weight / weight.sum() / theta[own])
        step = np.zeros(problem.placement)
        step[rigid] = whole
        placement = placement_after(problem.observed, placement, step)
        effects = list(here.model.effects)
        for k, share in zip(own, shares.T, strict=True):
            effects[k] = _with(effects[k], problem, share)
        here = replace(here, model=replace(here.model, effects=tuple(effects)))
        problem = here.at(theta, placement)
    again = iterate(here, theta, placement, kept, problem)
    return here, replace(again, status=fitted.status)


def _moved(fitting: Fitting, problem: Linearised, theta: Array, placement: Placement, own: IntArray) -> Array:
    """Return the displacement of each measurement by the instrument's effects, which have the indices `own` in the
    model.

    The instrument's displacement is the difference of predictions with and without its effects.
    """
    if problem.reduced is not None:
        return np.asarray(problem.columns[:, problem.placement + own] @ theta[own])
    without = theta.copy()
    without[own] = 0.0
    return fitting.with_residual_at(problem, without, placement).residual - problem.residual


def _least(columns: Array, target: Array) -> Array:
    """Return the least-squares solution of columns scaled to unit length; weak directions are truncated."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(columns / size, target, rcond=WEAKEST)[0] / size[:, None])


def _with(effect: Effect, problem: Linearised, share: Array) -> Effect:
    """Add rigid motions `share`, m and rad, to the motions that registration and tool absorb of an effect.

    A fitted registration turns about the mean of the points, an absorbed rigid motion about the instrument's origin.
    """
    known = {(r.of, r.label): np.array(r.twist) for r in effect.taken_up}
    names = [problem.placement_names[k] for k in np.flatnonzero(problem.rigid)]
    centre, data = problem.observed.tip[:, :3, 3].mean(axis=0), problem.poses.dataset
    for of, word in ((REGISTRATION, "registration"), (TOOL, "tool")):
        for label in sorted({*data.label(of).tolist()}):
            at = [k for k, name in enumerate(names) if name.rpartition(" ")[0] == f"{word} {label}".rstrip()]
            twist = np.zeros(6)
            twist[: len(at)] = share[at]
            if of == REGISTRATION:
                twist[:3] -= np.cross(twist[3:], centre)
            if twist.any():
                known[of, label] = known.get((of, label), 0.0) + twist
    return replace(effect, taken_up=tuple(TakenUp(*key, tuple(twist.tolist())) for key, twist in known.items()))


FREE_JOINTS_LIMIT = 50.0
"""Largest condition number of a fit with unmeasured joints. Source: Robertson (2003), 3.4."""

ATTEMPTS = 4
"""Largest number of fits that exclude outliers; each fit excludes the outliers of the previous fit."""

RATIO_SETTLED = 0.1
"""Change of the log variance shared by repeats of a pose, or of the log weight of a kind, at which weights have
converged. A smaller change of the weights alters standard errors by less than a twentieth."""

UNSETTLED = 1.1
"""Factor on the residual σ of an unconverged fit in the comparison with a converged fit of another condition limit."""

ROUNDING = 1e-6
"""Relative increase of a sum of squares that is rounding error."""


@dataclass(frozen=True)
class _Choices:
    """Mask of the fitted effects, selected condition limit, and cross-validated error by condition limit."""

    free: Mask
    limit: float
    curve: tuple[RankChoice, ...]


def calibrate(
    model: ErrorModel,
    poses: Poses,
    *,
    condition_limit: float | None = None,
    start: Calibration | None = None,
    robust: bool = True,
    seed: int = 0,
) -> Calibration:
    """Fit all parameters by damped Gauss-Newton with analytic derivatives.

    condition_limit: geometric constants with a unique share below 1 / limit are dropped and listed. None: the condition
    limit is chosen by cross-validation, or by the number of measurements if none determines the scale. The condition
    limit is lowered while the fit does not converge, unless σ grows by more than a tenth.
    start: calibration whose registration, tool and effects are the initial values; without `start`, registration and
    tool are fitted first.
    robust: whether to exclude outliers. seed: random seed of the cross-validation folds.
    If the final cost is larger than the initial cost, the initial values are returned with the status "kept previous".
    Raises InputError if there are fewer measurements than unknowns, or if all poses are equal.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        return _calibrate(model, poses, condition_limit, start, robust, seed)


def _calibrate(
    model: ErrorModel, poses: Poses, condition_limit: float | None, start: Calibration | None, robust: bool, seed: int
) -> Calibration:
    if free_joints(model.mechanism):
        check_points(poses.dataset)
        condition_limit = condition_limit or FREE_JOINTS_LIMIT
    use = np.ones(len(poses), dtype=bool)
    before: dict[str, float] = {}
    if start is None:
        first = Fitting(ErrorModel(model.mechanism, ()), poses, use, _starting_weights(poses), sharing(poses.dataset))
        placement = _placed(first)
        fitting = replace(first, model=model)
    else:
        if robust and len(start.error) == len(poses):
            use[start.outliers] = False
        weights = {**_starting_weights(poses), **start.weights}
        fitting = Fitting(model, poses, use, weights, sharing(poses.dataset), start.pose_ratio)
        placement = start.placement
        fitting = replace(fitting, model=with_taken_up(model, start.model))
        before = dict(zip((e.name for e in start.model.effects), start.theta.tolist(), strict=True))
    theta = np.array([before.get(e.name, 0.0) for e in model.effects])
    manner = _Manner(robust, seed)
    tried = [_fit(fitting, theta, placement, condition_limit, manner)]
    limits = [c.condition_limit for c in tried[0].rank_curve] or LIMITS
    for lower in sorted(limits if condition_limit is None else (), reverse=True):
        if lower < tried[-1].condition_limit and tried[-1].status != "converged":
            tried.append(replace(_fit(fitting, theta, placement, lower, manner), rank_curve=tried[0].rank_curve))
    best = min(tried, key=lambda fit: fit.sigma * (1.0 if fit.status == "converged" else UNSETTLED))
    return _by_direction(best, poses, replace(manner, robust=False), start.noise_shape if start else None)


def _by_direction(fit: Calibration, poses: Poses, manner: "_Manner", begin: Array | None) -> Calibration:
    """Weigh the coordinates of positions by their noise, unless the errors of values left out are then larger.

    The noise of each direction is that of the residuals, which depend on the weights; both are iterated, until errors
    are larger. The iteration begins with the noise `begin` of an earlier fit, if any. With equal weights undeclared
    effects along one direction cause smaller errors than with weights. Errors are larger if their mean square over the
    positions grows by more than a standard error. Source: Breiman et al. (1984), 3.4.3.
    """
    weighed, shape = fit, fit.shape if fit.shape is None or begin is None else begin
    for _ in range(ATTEMPTS):
        used = weighed.noise_shape
        if shape is None or (used is not None and np.abs(np.log(linalg.eigvalsh(shape, used))).max() < RATIO_SETTLED):
            break
        fitting = replace(fitting_of(weighed, poses), ratio=weighed.pose_ratio, noise_shape=shape)
        weighed = _fit(fitting, weighed.theta, weighed.placement, fit.condition_limit, manner)
        less = np.sum(fit.left_out**2 - weighed.left_out**2, axis=1)
        if np.mean(less) < -np.std(less) / np.sqrt(len(less)):
            return fit
        shape = weighed.shape
    return weighed if weighed is fit else replace(weighed, rank_curve=fit.rank_curve)


def _placed(bare: Fitting) -> Placement:
    """Fit registration and tool of the nominal mechanism from several initial values, to avoid local minima."""
    nothing = np.zeros(0, dtype=bool)
    reached = (iterate(bare, np.zeros(0), start, nothing) for start in start_placements(bare.poses))
    return min(reached, key=lambda found: residual_sigma(found.problem)).placement


@dataclass(frozen=True)
class _Manner:
    """Options of a calibration fit. robust: exclude outliers. seed: seed of the folds."""

    robust: bool
    seed: int


def _fit(
    fitting: Fitting, theta: Array, placement: Placement, condition_limit: float | None, manner: _Manner
) -> Calibration:
    """Choose the effects to fit, fit them, weigh kinds of measurements and exclude outliers, until both are settled.

    If outliers prevent convergence, the next fit without outliers begins again from the initial values.
    """
    origin = theta, placement
    fitted = Fitted(placement, theta, fitting.at(theta, placement), "converged")
    choices = _Choices(np.zeros(len(theta), dtype=bool), condition_limit or LARGEST_LIMIT, ())
    for attempt in range(ATTEMPTS):
        nominal = _nominal(fitting, fitted.placement)
        choices = _Choices(*choose(fitting.model, fitted.problem, nominal, fitted.theta, condition_limit, manner.seed))
        held = np.where(choices.free, fitted.theta, 0.0)
        same = np.array_equal(held, fitted.theta)
        fitted = iterate(fitting, held, fitted.placement, choices.free, fitted.problem if same else None)
        weights = estimated_weights(fitting, fitted, choices.free)
        ratio = pose_ratio(fitted.problem, fitting.block, fitting.ratio, float(choices.free.sum()))
        use, settled = fitting.use, fitted.status == "converged"
        reweighed = settled and max(abs(np.log(w / fitting.weights[k])) for k, w in weights.items()) > RATIO_SETTLED
        if manner.robust and not reweighed:
            use = without_outliers(fitted.problem.observed, fitting.poses.dataset, use, fitting.weights)
        again = reweighed or not np.array_equal(use, fitting.use)
        again = again or (settled and abs(np.log1p(ratio) - np.log1p(fitting.ratio)) > RATIO_SETTLED)
        if not again or attempt + 1 == ATTEMPTS:
            break
        if settled:
            fitting = replace(fitting, use=use, weights=weights, ratio=ratio)
        else:
            fitting, fitted = replace(fitting, use=use), replace(fitted, theta=origin[0], placement=origin[1])
        fitted = replace(fitted, problem=fitting.at(fitted.theta, fitted.placement))
    reason = REASONS[fitted.status]
    fitted, choices, better = _better(fitting, fitted, choices, origin)
    fitting, fitted = split(fitting, fitted, choices.free)
    return Calibration(
        **vars(uncertainty(fitting, fitted, choices.free)),
        model=fitting.model, placement=fitted.placement, theta=fitted.theta, free=choices.free,
        error=pose_error(fitted.problem.observed, fitting.poses.dataset, fitting.weights),
        outliers=np.flatnonzero(~fitting.use),
        condition_limit=choices.limit, rank_curve=choices.curve, weights=fitting.weights,
        pose_ratio=fitting.ratio, noise_shape=fitting.noise_shape, status=fitted.status, reason=better or reason,
    )  # fmt: skip


def _nominal(fitting: Fitting, placement: Placement) -> Linearised:
    """Linearise the measurements in the constant effects alone, about the nominal geometry."""
    constant = tuple(e for e in fitting.model.effects if e.constant)
    model = ErrorModel(fitting.model.mechanism, constant)
    return replace(fitting, model=model).at(np.zeros(len(constant)), placement)


def _better(
    fitting: Fitting, fitted: Fitted, choices: _Choices, origin: tuple[Array, Placement]
) -> tuple[Fitted, _Choices, str]:
    """Return the fit and "", or, if their cost on equal poses is smaller, the initial values and the reason."""
    theta, placement = origin
    free = fitted.problem.reduced is not None
    start = fitting.at(theta, placement) if free else fitting.with_residual_at(fitted.problem, theta, placement)
    weighed = linear_step(fitting.model, fitted.problem, fitted.theta, fitted.placement, choices.free, None)
    before = fitting.cost(start, theta, placement, weighed)
    after = fitting.cost(fitted.problem, fitted.theta, fitted.placement, weighed)
    if after <= (1.0 + ROUNDING) * before:
        return fitted, choices, ""
    left = [1e3 * residual_sigma(problem) for problem in (fitted.problem, start)]
    text = f"{left[0]:.4g} mm a component after the fit, {left[1]:.4g} mm before it"
    kept = Fitted(placement, theta, fitting.at(theta, placement), "kept previous")
    return kept, replace(choices, free=choices.free & (theta != 0.0)), text


def without_outliers(observed: Observed, dataset: Dataset, use: Mask, weights: Weights) -> Mask:
    """Return a mask of poses without isolated outliers, which are at most a share OUTLIER_SHARE of the poses."""
    error = pose_error(observed, dataset, weights)
    far = error > outlier_limit(error[use])
    far &= use & ~in_company(far, dataset.q, measured_minus(observed, dataset))
    return use & ~(far & among_worst(error, use))


def _starting_weights(poses: Poses) -> dict[str, float]:
    """Return the weights of all kinds of measurements before their noise is estimated, m per unit."""
    return {**{kind.name: kind.metres for kind in observations(poses.dataset)}, **STARTING_WEIGHTS}


def fitting_of(fit: Calibration, poses: Poses) -> Fitting:
    """Return the least-squares problem of a fit to `poses` without the fit's outliers. Repeats of a pose count as
    independent measurements."""
    use = np.ones(len(poses), dtype=bool)
    use[fit.outliers] = False
    return Fitting(fit.model, poses, use, fit.weights, sharing(poses.dataset), noise_shape=fit.noise_shape)
