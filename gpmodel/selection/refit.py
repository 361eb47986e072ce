"""The exact chain with what was selected: a damped fit with the learned variances as priors, and who stands far out."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.iterate import Fitting, iterate
from gpmodel.calibration.linear_step import linear_step
from gpmodel.calibration.linearise import Linearised
from gpmodel.model.effect import Term
from gpmodel.model.error_model import Placement, pose_error
from gpmodel.numerics.least_squares import inverse_of
from gpmodel.numerics.outliers import among_worst, outlier_limit


@dataclass(frozen=True)
class Expansion:
    """Where the chain is linearised: what is fitted to what, values (E,), placement, σ of one measurement, m.

    variances, left: of the groups in the model, by name, the variance and the terms of the effects that are left.
    """

    fitting: Fitting
    theta: Array
    placement: Placement
    sigma: float
    variances: Mapping[str, float] = field(default_factory=dict)
    left: Mapping[str, frozenset[tuple[Term, ...]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Refit:
    """The fit at a state. problem: its rows independent. unknowns: that the measurements determine. error: (N,) m."""

    state: Expansion
    problem: Linearised
    unknowns: float
    error: Array


def refit(state: Expansion) -> Refit:
    """Solve all values and the placement on the exact chain: θ ~ N(0, prior²), the noise and its levels as of a state.

    By the damped steps of a calibration: none is taken that does not lower the sum of squares, priors included.
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
    return Refit(there, problem, unknowns, pose_error(problem.observed, state.fitting.poses.dataset))


def far_out(error: Array, use: Mask, sigmas: float) -> Mask:
    """The poses (N,) in use, judged anew: within so many robust deviations of the median error, at most a tenth left
    out."""
    return ~((error > outlier_limit(error[use], sigmas)) & among_worst(error))
