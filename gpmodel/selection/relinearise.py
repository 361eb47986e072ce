"""Linearise the kinematic chain, make a step of the selection, and fit the exact chain with the selected groups."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.iterate import Fitting, iterate, linear_step
from gpmodel.calibration.linearise import Linearised
from gpmodel.calibration.noise import blocks_of, pose_ratio
from gpmodel.calibration.priors import off_mean
from gpmodel.evidence.criteria import Criteria
from gpmodel.model.effect import Term
from gpmodel.model.error_model import ErrorModel, Placement, pose_error
from gpmodel.numerics.least_squares import among_worst, inverse_of, outlier_limit
from gpmodel.selection.group import Group, Price, Shapes
from gpmodel.selection.pool import GroupPool, Rows
from gpmodel.selection.posterior import LEAST_NOISE, Active
from gpmodel.selection.sparse_bayes import reestimate


@dataclass(frozen=True)
class Expansion:
    """Values at which the kinematic chain is linearised, and the groups of effects in the model.

    fitting: model, poses and weights of the fit.
    theta: values of the effects, rad, m or another SI unit.
    placement: values of registration and tool point.
    sigma: standard deviation of one measured coordinate, m.
    variances: prior variance of each group of effects in the model, by name of the group.
    left: terms of the effects of each group that remain in the model, by name of the group.
    """

    fitting: Fitting
    theta: Array
    placement: Placement
    sigma: float
    variances: Mapping[str, float] = field(default_factory=dict)
    left: Mapping[str, frozenset[tuple[Term, ...]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Refit:
    """Fit of the exact (nonlinear) kinematic chain.

    state: fitted values of the effects, at which the chain is linearised next.
    problem: problem linearised at the fitted values, with independent rows.
    unknowns: number of fitted unknowns that the measurements determine.
    error: 3-D error of each pose, m.
    """

    state: Expansion
    problem: Linearised
    unknowns: float
    error: Array


def refit(state: Expansion) -> Refit:
    """Fit all effects θ ~ N(0, prior²), registration and tool on the exact chain, with the noise `state.sigma`, m.

    Each damped step lowers the sum of squares of the weighted residuals and of the effects over their priors.
    """
    inflation = 1.0 + state.fitting.ratio
    model = replace(state.fitting.model, noise=state.sigma * float(np.sqrt(inflation)))
    fitting = replace(state.fitting, model=model)
    everything = np.ones(len(model.effects), dtype=bool)
    fitted = iterate(fitting, state.theta, state.placement, everything)
    problem = fitting.at(fitted.theta, fitted.placement)
    linear = linear_step(model, problem, fitted.theta, fitted.placement, everything, None)
    scaled = problem.columns / linear.scale
    inverse = inverse_of(scaled.T @ scaled + linear.priors.T @ linear.priors)
    unknowns = len(inverse) - float(np.sum((linear.priors @ inverse) * linear.priors))
    variance = float(problem.residual @ problem.residual) / max(len(problem.residual) - unknowns, 1.0)
    sigma = float(np.sqrt(variance / inflation))
    there = replace(state, theta=fitted.theta, placement=fitted.placement, sigma=sigma)
    return Refit(there, problem, unknowns, pose_error(problem.observed, fitting.poses.dataset, fitting.weights))


def inliers(error: Array, use: Mask, sigmas: float) -> Mask:
    """Mark the poses with an error within `sigmas` robust deviations; at most the share OUTLIER_SHARE is unmarked.

    error: error of each pose, m. use: mask of the poses that count for the median error.
    """
    return ~((error > outlier_limit(error[use], sigmas)) & among_worst(error))


UNKNOWN = 1e-6
"""Initial prior variance of a group that is always included, rad² or m²; re-estimation changes the variance."""


@dataclass(frozen=True)
class Screening:
    """Values of basis functions at the training poses, and penalties of groups of effects, for a whole selection."""

    shapes: Shapes
    prices: Price


def relinearised(
    screening: Screening, groups: Sequence[Group], state: Expansion, step: Callable[[Active], Active]
) -> tuple[Active, Expansion]:
    """Linearise the kinematic chain at `state`, make a step of the selection, then fit the exact chain."""
    active = step(_started(screening, groups, state))
    return active, _refitted(active, screening, state)


def with_only(screening: Screening, groups: Sequence[Group], state: Expansion) -> Active:
    """Linearise the kinematic chain at `state`, and fit only the groups of effects that are always in the model."""
    return reestimate(_started(screening, groups, state))


def _started(screening: Screening, groups: Sequence[Group], state: Expansion) -> Active:
    """Linearise the kinematic chain at `state`, with earlier groups; coefficients are relative to prior means."""
    fitting, model = state.fitting, state.fitting.model
    problem = fitting.linearised(state.theta, state.placement)
    target = problem.residual + problem.columns[:, problem.placement :] @ off_mean(model, state.theta)
    noise = blocks_of(problem, fitting.block, fitting.ratio)
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
    """Fit the exact kinematic chain with the groups of a linear model, then determine outliers and noise again."""
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
    use = inliers(fit.error, fitting.use, screening.prices.limits.outlier_sigmas)
    if not use.all():
        use |= _readmitted(fit.state, screening.prices.limits)
    if (use != fitting.use).any():
        fitting = replace(fitting, use=use)
        fit = refit(replace(fit.state, fitting=fitting, sigma=sigma))
    ratio = pose_ratio(fit.problem, fitting.block, fitting.ratio, fit.unknowns - fit.problem.placement)
    return replace(fit.state, fitting=replace(fitting, ratio=ratio))


def _readmitted(state: Expansion, criteria: Criteria) -> Mask:
    """Return the mask of inliers of a fit to all poses, since the model may now explain earlier outliers."""
    everything = np.ones(len(state.fitting.use), dtype=bool)
    fit = refit(replace(state, fitting=replace(state.fitting, use=everything)))
    return inliers(fit.error, everything, criteria.outlier_sigmas)
