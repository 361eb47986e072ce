"""Selection of groups: linearise, choose, solve the exact chain, look again."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from gpmodel.arrays import IntArray, Mask
from gpmodel.calibration.iterate import Fitting
from gpmodel.calibration.linearise import linearise
from gpmodel.calibration.noise import blocks_of, pose_ratio
from gpmodel.calibration.priors import off_mean
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.units import exchangeable
from gpmodel.executor import Workers, called
from gpmodel.forks import ALONE
from gpmodel.model.error_model import ErrorModel, Poses, observe
from gpmodel.model.states import States
from gpmodel.selection.active import LEAST_NOISE, Active
from gpmodel.selection.by_chance import best_by_chance
from gpmodel.selection.exchange import exchanged
from gpmodel.selection.group import Group, Shapes, geometry_groups
from gpmodel.selection.moves import stepwise, with_optimal_variances
from gpmodel.selection.offers import Offering, offered
from gpmodel.selection.pool import GroupPool
from gpmodel.selection.refit import Expansion, far_out, refit
from gpmodel.selection.result import Selection, summarised
from gpmodel.selection.rows import Rows
from gpmodel.selection.surfaces import surfaces_left
from gpmodel.selection.waves import waves_left
from gpmodel.table.bundles import sharing

MOST_LOOKS = 3
"""Linearisations at most; the second usually finds nothing to change."""
SCREENING_POSES = 1500
"""As many tell groups of a few nats from none; the numbers are fitted to all."""


@dataclass(frozen=True)
class _Task:
    """What stays the same: the sample that is chosen on, its shapes, the limits."""

    sample: IntArray
    shapes: Shapes
    criteria: Criteria


def select(
    calibration: Calibration,
    poses: Poses,
    offering: Offering,
    *,
    criteria: Criteria | None = None,
    seed: int = 0,
    workers: Workers = ALONE,
) -> Selection:
    """Choose the groups that the marginal likelihood wants beside the calibration's own effects.

    poses: those the calibration was fitted to. criteria: limits of the choice and the number of permuted residuals that
    the groups are scored on; seed: of their order. workers: of the searches for waves and for free functions.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        return _select(calibration, poses, offering, np.random.default_rng(seed), criteria or Criteria(), workers)


def _select(
    calibration: Calibration,
    poses: Poses,
    offering: Offering,
    rng: np.random.Generator,
    criteria: Criteria,
    workers: Workers,
) -> Selection:
    mechanism = calibration.model.mechanism
    bundle = sharing(poses.dataset)
    sample = _sample_of(bundle)
    shapes = Shapes(_predicted_states(calibration, poses.subset(sample)))
    base = list(geometry_groups(calibration.model.effects))
    use = np.ones(len(poses), dtype=bool)
    use[calibration.outliers] = False
    task = _Task(sample, shapes, criteria)
    fitting = Fitting(calibration.model, poses, use, calibration.rotation_weight, bundle)
    theta, placement = calibration.theta, calibration.placement
    ratio = pose_ratio(fitting.at(theta, placement), bundle, 0.0, float(len(theta)))
    state = Expansion(replace(fitting, ratio=ratio), theta, placement, calibration.sigma)
    single = [*offered(offering, mechanism, shapes), *_free(_left(task, base, state), offering)]
    state = _refitted(stepwise(_started(task, [*base, *single], state)), task, state)
    groups = [*base, *single]
    kept = [g for g in groups if g.always_included or g.name in state.variances]
    left = _left(task, kept, state)
    waves, free = called(workers, [partial(waves_left, left, offering.grids), partial(_free, left, offering)])
    names = {g.name for g in (*groups, *waves)}
    groups += [*waves, *(g for g in free if g.name not in names)]
    for _ in range(MOST_LOOKS):
        active, rivals = exchanged(stepwise(_started(task, groups, state)))
        before = state
        state = _refitted(active, task, before)
        if _same(before, state):
            break
    together = exchangeable(poses.dataset.subset(sample), criteria)
    chance = best_by_chance(active, offering.grids, together, rng, criteria.shuffles)
    return summarised(active, rivals, state, chance)


def _sample_of(bundle: IntArray) -> IntArray:
    """The poses to choose on: all, or whole bundles of about SCREENING_POSES evenly along the rows."""
    if len(bundle) <= SCREENING_POSES:
        return np.arange(len(bundle))
    share = SCREENING_POSES / len(bundle)
    numbers = np.unique(bundle)
    chosen = numbers[np.floor(np.arange(len(numbers)) * share) != np.floor((np.arange(len(numbers)) - 1) * share)]
    return np.flatnonzero(np.isin(bundle, chosen))


def _predicted_states(calibration: Calibration, poses: Poses) -> States:
    """The states of poses, the instrument looking at where the model has them.

    Where it measured them is no input: a column that holds the noise, and lengths that take the arm away, explain it.
    """
    there = resolved(calibration, poses)
    observed = observe(calibration.model, there, calibration.theta, calibration.placement)
    if there.states.seen is None:
        return there.states
    points = there.states.seen.points.copy()
    points[slice(None) if there.states.rows is None else there.states.rows] = observed.tip[:, :3, 3]
    return replace(there.states, seen=replace(there.states.seen, points=points))


def _left(task: _Task, beside: Sequence[Group], state: Expansion) -> Active:
    """What some groups leave."""
    return with_optimal_variances(_started(task, beside, state))


def _free(left: Active, offering: Offering) -> list[Group]:
    """The free functions that what a model leaves asks for."""
    if not offering.inputs:
        return []
    return [group for group in surfaces_left(left, offering.sites, offering.inputs) if offering.wanted(group)]


def _started(task: _Task, groups: Sequence[Group], state: Expansion) -> Active:
    """The problem linearised at a state, with what was chosen before; unknowns are totals, from their means."""
    fitting, sample = state.fitting, task.sample
    model, part = fitting.model, fitting.poses.subset(sample)
    problem = linearise(model, part, state.theta, state.placement, fitting.rotation_weight, fitting.use[sample])
    target = problem.residual + problem.columns[:, problem.placement :] @ off_mean(model, state.theta)
    noise = blocks_of(problem, fitting.bundle[sample], fitting.ratio)
    rows = Rows(model.mechanism, problem, target, noise, task.shapes)
    pool = GroupPool(rows, groups, task.criteria)
    active = Active(pool, {}, {}, max(state.sigma, LEAST_NOISE) ** 2)
    for g, group in enumerate(groups):
        if group.always_included or group.name in state.variances:
            active = active.added(g, state.variances.get(group.name, 1e-6))
            if group.name in state.chosen:
                active = replace(active, chosen={**active.chosen, g: state.chosen[group.name]})
    return active


def _refitted(active: Active, task: _Task, state: Expansion) -> Expansion:
    """The exact fit with what is active, outliers and the noise's levels judged anew."""
    fitting = state.fitting
    before = dict(zip((e.terms for e in fitting.model.effects), state.theta, strict=True))
    effects, variances, chosen = [], {}, {}
    for g, a in active.variances.items():
        group = active.pool.groups[g]
        prior = group.with_prior(a)
        effects += [prior[k] for k in active.chosen[g]]
        variances[group.name], chosen[group.name] = a, active.chosen[g]
    mean = dict(zip((active.pool.effects[i].terms for i in active.index), active.mean * active.scale, strict=True))
    theta = np.array([before.get(e.terms, mean[e.terms]) for e in effects])
    sigma = float(np.sqrt(active.sigma2))
    fitting = replace(fitting, model=ErrorModel(fitting.model.mechanism, tuple(effects)))
    fit = refit(Expansion(fitting, theta, state.placement, sigma, variances, chosen))
    use = far_out(fit.error, fitting.use, task.criteria.outlier_sigmas)
    if not use.all():
        use |= _back_in(fit.state, task.criteria)
    if (use != fitting.use).any():
        fitting = replace(fitting, use=use)
        fit = refit(replace(fit.state, fitting=fitting, sigma=sigma))
    ratio = pose_ratio(fit.problem, fitting.bundle, fitting.ratio, fit.unknowns - fit.problem.placement)
    return replace(fit.state, fitting=replace(fitting, ratio=ratio))


def _back_in(state: Expansion, criteria: Criteria) -> Mask:
    """The poses (N,) that do not stand far out of a fit to all of them.

    Those that stood out of the model before, and were left out of this one's fit, may be what it is there for."""
    everything = np.ones(len(state.fitting.use), dtype=bool)
    fit = refit(replace(state, fitting=replace(state.fitting, use=everything)))
    return far_out(fit.error, everything, criteria.outlier_sigmas)


def _same(before: Expansion, after: Expansion) -> bool:
    """Whether another look would see the same problem: the same poses in use, the same noise on both levels."""
    first, second = before.fitting, after.fitting
    return (
        bool((first.use == second.use).all())
        and abs(np.log1p(first.ratio) - np.log1p(second.ratio)) < 0.1
        and abs(np.log(before.sigma / after.sigma)) < 0.05
    )
