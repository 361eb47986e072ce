"""Calibration: registration, tool, anchors and every effect solved together."""

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.calibration.gauge import LARGEST_LIMIT, choose
from gpmodel.calibration.iterate import REASONS, Fitted, Fitting, iterate, linear_step
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.noise import pose_ratio
from gpmodel.calibration.priors import residual_sigma
from gpmodel.calibration.result import Calibration, uncertainty
from gpmodel.calibration.start import placement_after, start_placements
from gpmodel.calibration.unmeasured_joints import ROTATION_WEIGHT, check_points, free_joints
from gpmodel.model.effect import REGISTRATION, TOOL, Effect, TakenUp
from gpmodel.model.error_model import ErrorModel, Placement, Poses, measured_minus, pose_error
from gpmodel.model.observed import Observed
from gpmodel.numerics.least_squares import among_worst, in_company, outlier_limit
from gpmodel.numerics.rank import LIMITS, RankChoice
from gpmodel.table.bundles import sharing
from gpmodel.table.dataset import Dataset

STEPS = 10
"""Largest number of steps of the split; three are usual."""

SETTLED = 1e-8
"""Motion of every reading by the last step, m: a hundredth of what instruments resolve."""

WEAKEST = 1e-3
"""Smallest singular value of the unit columns of registration and tool along which they absorb a residual. A smaller
one turns a millimetre of reading into a metre of tool."""


def with_taken_up(model: ErrorModel, known: ErrorModel) -> ErrorModel:
    """The model with its effects in the gauge that a known model has them in.

    With D (M, K) the columns of the instrument's effects, P those of registrations and tools and G = P⁺ D, an error θ D
    of the readings is P G θ + (D - P G) θ. The first part is where robot and tool are, the second the instrument's. A
    fit leaves the split open: its readings say the sum alone.
    """
    there = {(e.name, e.terms): e.taken_up for e in known.effects if e.taken_up}
    if not there:
        return model
    effects = tuple(replace(e, taken_up=there.get((e.name, e.terms), e.taken_up)) for e in model.effects)
    return replace(model, effects=effects)


def split(fitting: Fitting, fitted: Fitted, kept: Mask) -> tuple[Fitting, Fitted]:
    """The fit with the rigid part of its instrument's effects in registrations and tools, its readings the same.

    kept: effects (E,) that are fitted.
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
    """Return the displacement of the readings by effects (M,), with minus without them; first order with free
    joints.
    """
    if problem.left is not None:
        return np.asarray(problem.columns[:, problem.placement + own] @ theta[own])
    without = theta.copy()
    without[own] = 0.0
    return fitting.beside(problem, without, placement).residual - problem.residual


def _least(columns: Array, target: Array) -> Array:
    """The least-squares solution (P, K) in columns (M, P) of length one, along those directions that do anything."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(np.linalg.lstsq(columns / size, target, rcond=WEAKEST)[0] / size[:, None])


def _with(effect: Effect, problem: Linearised, share: Array) -> Effect:
    """The effect with further rigid motions (R,) taken up.

    Those of a problem turn about the middle of its points, those of an effect about the instrument's origin."""
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
"""Condition limit in a fit with unmeasured joints. Source: Robertson (2003), 3.4."""

ATTEMPTS = 4
"""Largest number of fits, each without the outliers of the one before."""

RATIO_SETTLED = 0.1
"""Change of the logarithm of a pose's variance at which the weights have settled. It moves standard errors by less than
a twentieth."""

UNSETTLED = 1.1
"""Factor on σ up to which a converged fit is preferred to an unconverged one with another limit."""

ROUNDING = 1e-6
"""Relative rise of a sum of squares that is rounding."""


@dataclass(frozen=True)
class _Choices:
    """Rank choice: held parameters, condition limit, and the curve from which it was chosen."""

    kept: Mask
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
    """Fit every parameter by damped Gauss-Newton on the analytic columns; never worse than where it started.

    condition_limit: constant effects whose share is under 1 / limit are dropped and named; None chooses it by
    cross-validation over rank.LIMITS, or by the number of readings where none shows size, and goes down from there
    until the fit converges, where that does not cost more than a tenth of the error. start: a calibration to go on from
    (its placement, the values of effects of the same name); without it, registration and tool are fitted first.
    Where the fit ends above its start, the numbers of the start are kept and the status says so.
    Raises InputError with fewer observations than unknowns or poses all alike.
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
        first = Fitting(ErrorModel(model.mechanism, ()), poses, use, ROTATION_WEIGHT, sharing(poses.dataset))
        placement = _placed(first)
        fitting = replace(first, model=model)
    else:
        if robust and len(start.error) == len(poses):
            use[start.outliers] = False
        fitting = Fitting(model, poses, use, start.rotation_weight, sharing(poses.dataset), start.pose_ratio)
        placement = start.placement
        fitting = replace(fitting, model=with_taken_up(model, start.model))
        before = dict(zip((e.name for e in start.model.effects), start.theta.tolist(), strict=True))
    theta = np.array([before.get(e.name, 0.0) for e in model.effects])
    fresh = poses.dataset.has_rotation and start is None
    manner = _Manner(robust, fresh, seed)
    tried = [_fit(fitting, theta, placement, condition_limit, manner)]
    limits = [c.condition_limit for c in tried[0].rank_curve] or LIMITS
    for lower in sorted(limits if condition_limit is None else (), reverse=True):
        if lower < tried[-1].condition_limit and tried[-1].status != "converged":
            tried.append(replace(_fit(fitting, theta, placement, lower, manner), rank_curve=tried[0].rank_curve))
    return min(tried, key=lambda fit: fit.sigma * (1.0 if fit.status == "converged" else UNSETTLED))


def _placed(bare: Fitting) -> Placement:
    """The placement of the nominal mechanism that fits best, of those reached from every start: minima that are none of
    the whole are reached from several as well."""
    nothing = np.zeros(0, dtype=bool)
    reached = (iterate(bare, np.zeros(0), start, nothing) for start in start_placements(bare.poses))
    return min(reached, key=lambda found: residual_sigma(found.problem)).placement


@dataclass(frozen=True)
class _Manner:
    """robust: outliers are left out. weigh: the weight of rotations is found as well. seed: of the folds."""

    robust: bool
    weigh: bool
    seed: int


def _fit(
    fitting: Fitting, theta: Array, placement: Placement, condition_limit: float | None, manner: _Manner
) -> Calibration:
    """Choose, iterate, look for outliers, and again until none is new; from the start where they let no fit settle."""
    origin = theta, placement
    fitted = Fitted(placement, theta, fitting.at(theta, placement), "converged")
    choices = _Choices(np.zeros(len(theta), dtype=bool), condition_limit or LARGEST_LIMIT, ())
    for attempt in range(ATTEMPTS):
        nominal = _nominal(fitting, fitted.placement)
        choices = _Choices(*choose(fitting.model, fitted.problem, nominal, fitted.theta, condition_limit, manner.seed))
        held = np.where(choices.kept, fitted.theta, 0.0)
        same = np.array_equal(held, fitted.theta)
        fitted = iterate(fitting, held, fitted.placement, choices.kept, fitted.problem if same else None)
        use = fitting.use
        if manner.robust:
            use = without_outliers(fitted.problem.observed, fitting.poses.dataset, use)
        weight = fitting.rotation_weight
        ratio = pose_ratio(fitted.problem, fitting.bundle, fitting.ratio, float(choices.kept.sum()))
        fewer, settled = not np.array_equal(use, fitting.use), fitted.status == "converged"
        again = fewer or (settled and abs(np.log1p(ratio) - np.log1p(fitting.ratio)) > RATIO_SETTLED)
        if manner.weigh and attempt == 0:
            weight, again = _rotation_weight(fitted.problem, fitting.poses), settled or fewer
        if not again or attempt + 1 == ATTEMPTS:
            break
        if settled:
            fitting = replace(fitting, use=use, rotation_weight=weight, ratio=ratio)
        else:
            fitting, fitted = replace(fitting, use=use), replace(fitted, theta=origin[0], placement=origin[1])
        fitted = replace(fitted, problem=fitting.at(fitted.theta, fitted.placement))
    reason = REASONS[fitted.status]
    fitted, choices, better = _better(fitting, fitted, choices, origin)
    fitting, fitted = split(fitting, fitted, choices.kept)
    return Calibration(
        **vars(uncertainty(fitting, fitted, choices.kept)),
        model=fitting.model, placement=fitted.placement, theta=fitted.theta, kept=choices.kept,
        error=pose_error(fitted.problem.observed, fitting.poses.dataset), outliers=np.flatnonzero(~fitting.use),
        condition_limit=choices.limit, rank_curve=choices.curve, rotation_weight=fitting.rotation_weight,
        pose_ratio=fitting.ratio, status=fitted.status, reason=better or reason,
    )  # fmt: skip


def _nominal(fitting: Fitting, placement: Placement) -> Linearised:
    """The problem of the constant effects alone, at the nominal geometry."""
    constant = tuple(e for e in fitting.model.effects if e.constant)
    model = ErrorModel(fitting.model.mechanism, constant)
    return replace(fitting, model=model).at(np.zeros(len(constant)), placement)


def _better(
    fitting: Fitting, fitted: Fitted, choices: _Choices, origin: tuple[Array, Placement]
) -> tuple[Fitted, _Choices, str]:
    """The fit or, where that ended above it on the same poses, its start; and the reason in words, else empty."""
    theta, placement = origin
    free = fitted.problem.left is not None
    start = fitting.at(theta, placement) if free else fitting.beside(fitted.problem, theta, placement)
    weighed = linear_step(fitting.model, fitted.problem, fitted.theta, fitted.placement, choices.kept, None)
    before = fitting.cost(start, theta, placement, weighed)
    after = fitting.cost(fitted.problem, fitted.theta, fitted.placement, weighed)
    if after <= (1.0 + ROUNDING) * before:
        return fitted, choices, ""
    left = [1e3 * residual_sigma(problem) for problem in (fitted.problem, start)]
    text = f"{left[0]:.4g} mm a component after the fit, {left[1]:.4g} mm before it"
    kept = Fitted(placement, theta, fitting.at(theta, placement), "kept previous")
    return kept, replace(choices, kept=choices.kept & (theta != 0.0)), text


def without_outliers(observed: Observed, dataset: Dataset, use: Mask) -> Mask:
    """Mask (N,) of the poses without isolated outliers, the largest first, at most OUTLIER_SHARE of them."""
    error = pose_error(observed, dataset)
    far = error > outlier_limit(error[use])
    far &= use & ~in_company(far, dataset.q, measured_minus(observed, dataset))
    return use & ~(far & among_worst(error, spared=int((~use).sum())))


def _rotation_weight(problem: Linearised, poses: Poses) -> float:
    """Metres a radian is worth: ratio of the robust spreads of length and angle residuals."""
    residual, turns = measured_minus(problem.observed, poses.dataset), problem.observed.turns
    lengths, angles = np.nanmedian(np.abs(residual[:, ~turns])), np.nanmedian(np.abs(residual[:, turns]))
    return float(np.clip(lengths / angles, 0.01, 10.0)) if lengths > 0 and angles > 0 else ROTATION_WEIGHT


def fitting_of(fit: Calibration, poses: Poses) -> Fitting:
    """Return the problem of a fit to poses without its outliers, repeats of a pose as independent rows."""
    use = np.ones(len(poses), dtype=bool)
    use[fit.outliers] = False
    return Fitting(fit.model, poses, use, fit.rotation_weight, sharing(poses.dataset))
