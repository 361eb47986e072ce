"""One look: the chain linearised where it was left, groups chosen of all that is offered, the exact chain solved."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Mask
from gpmodel.calibration.noise import blocks_of, pose_ratio
from gpmodel.calibration.priors import off_mean
from gpmodel.evidence.criteria import Criteria
from gpmodel.model.error_model import ErrorModel
from gpmodel.selection.active import LEAST_NOISE, Active
from gpmodel.selection.alternatives import Alternative, alternatives
from gpmodel.selection.group import Group, Shapes
from gpmodel.selection.pool import GroupPool
from gpmodel.selection.price import Price
from gpmodel.selection.refit import Expansion, far_out, refit
from gpmodel.selection.rows import Rows
from gpmodel.selection.sparse_bayes import reestimate

UNKNOWN = 1e-6
"""Variance from which that of a group is sought which is always in the model."""


@dataclass(frozen=True)
class Screening:
    """Shapes of bases over the training poses, and the prices of groups."""

    shapes: Shapes
    prices: Price


@dataclass(frozen=True)
class Look:
    """What a look chose, what could stand in the place of each of its groups, and the exact fit behind it."""

    active: Active
    rivals: Mapping[int, tuple[Alternative, ...]]
    state: Expansion


def looked(screening: Screening, groups: Sequence[Group], state: Expansion, step: Callable[[Active], Active]) -> Look:
    """Take a step of the selection from what was selected before, and fit the exact chain with it."""
    active = step(_started(screening, groups, state))
    return Look(active, alternatives(active), _refitted(active, screening, state))


def left_by(screening: Screening, beside: Sequence[Group], state: Expansion) -> Active:
    """What some groups leave."""
    return reestimate(_started(screening, beside, state))


def _started(screening: Screening, groups: Sequence[Group], state: Expansion) -> Active:
    """The problem linearised at a state, with what was chosen before; unknowns are totals, from their means."""
    fitting, model = state.fitting, state.fitting.model
    problem = fitting.linearised(state.theta, state.placement)
    target = problem.residual + problem.columns[:, problem.placement :] @ off_mean(model, state.theta)
    noise = blocks_of(problem, fitting.bundle, fitting.ratio)
    rows = Rows(model.mechanism, problem, target, noise, screening.shapes)
    pool = GroupPool(rows, groups, screening.prices)
    active = Active(pool, {}, {}, max(state.sigma, LEAST_NOISE) ** 2)
    for g, group in enumerate(groups):
        if group.always_included or group.name in state.variances:
            left = state.left.get(group.name)
            those = [k for k, e in enumerate(group.effects) if left is None or e.terms in left]
            if those:
                active = active.added(g, state.variances.get(group.name, UNKNOWN), those)
    return active


def _refitted(active: Active, screening: Screening, state: Expansion) -> Expansion:
    """The exact fit with what is active, outliers and the noise's levels judged anew."""
    fitting = state.fitting
    before = dict(zip((e.terms for e in fitting.model.effects), state.theta, strict=True))
    effects, variances, left = [], {}, {}
    for g, a in active.variances.items():
        group = active.pool.groups[g]
        prior = group.with_prior(a)
        effects += [prior[k] for k in active.chosen[g]]
        variances[group.name] = a
        left[group.name] = frozenset(prior[k].terms for k in active.chosen[g])
    mean = dict(zip((active.pool.effects[i].terms for i in active.index), active.mean * active.scale, strict=True))
    theta = np.array([before.get(e.terms, mean[e.terms]) for e in effects])
    sigma = float(np.sqrt(active.sigma2))
    fitting = replace(fitting, model=ErrorModel(fitting.model.mechanism, tuple(effects)))
    fit = refit(Expansion(fitting, theta, state.placement, sigma, variances, left))
    use = far_out(fit.error, fitting.use, screening.prices.limits.outlier_sigmas)
    if not use.all():
        use |= _back_in(fit.state, screening.prices.limits)
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
