"""Test whether a further machine differs from its type more than the machines of the type do.

y = X (θ - μ) + e,   θ - μ ~ N(0, s² T),   e ~ N(0, σ² 1)            y: readings without the placement
"""

from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from gpmodel.calibration.priors import off_mean
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.model.error_model import Poses
from gpmodel.numerics import rank as ident

LARGEST = 1e3
"""Largest s, and largest σ over the noise of the type, that are sought."""

DOUBTFUL, TWICE = 1e-3, 2.0
"""Chance and s from where a machine is no brother; the chance counts the prior as known, which machines only estimate,
so that s has to be 2 as well."""


@dataclass(frozen=True)
class Likeness:
    """times: s, how many times farther from the mean of its type a machine is than the type's machines. chance: of at
    least that in a brother. noise: σ of one component, m, of a brother."""

    times: float
    chance: float
    noise: float

    @property
    def brother(self) -> bool:
        """True unless the machine differs from its type clearly more than the machines of the type do."""
        return self.times < TWICE or self.chance > DOUBTFUL


def likeness(fit: Calibration, poses: Poses) -> Likeness:
    """Compare a machine with its type by the marginal likelihood of s ≥ 1, σ at its most likely value for each s.

    fit: to the poses with the prior and the noise of the type. Effects without a prior are fitted, not compared. The
    larger of the noise and σ explains what the effects of the type cannot. Chance: half of χ² of one degree of freedom,
    as s = 1 is a bound (Self and Liang 1987).
    """
    problem, noise = problem_at(fit, poses), fit.model.noise or fit.sigma
    prior = np.array([e.prior for e in fit.model.effects])
    believed = np.isfinite(prior)
    columns, count = problem.columns[:, problem.placement :], len(problem.residual)
    free = np.hstack([problem.columns[:, : problem.placement], columns[:, ~believed]])
    fixed = ident.orthonormal(free)
    shown = ident.remove(fixed, columns[:, believed]) * (prior[believed] / noise)
    left = ident.remove(fixed, problem.residual + columns @ off_mean(fit.model, fit.theta)) / noise
    basis, sizes, _ = np.linalg.svd(shown, full_matrices=False)
    seen = sizes > 1e-9 * sizes.max(initial=0.0)
    parts, squares = (basis.T @ left)[seen] ** 2, sizes[seen] ** 2
    rest = max(float(left @ left - parts.sum()), 0.0)
    alone = max(count - fixed.shape[1] - int(seen.sum()), 0)

    def misfit(log_s: float, log_noise: float) -> float:
        variance = np.exp(2.0 * log_noise)
        expected = variance + np.exp(2.0 * log_s) * squares
        return float(np.sum(np.log(expected) + parts / expected) + 2.0 * alone * log_noise + rest / variance)

    def least(log_s: float) -> tuple[float, float]:
        found = optimize.minimize_scalar(lambda n: misfit(log_s, n), bounds=(0.0, np.log(LARGEST)), method="bounded")
        return float(found.fun), float(found.x)

    best = optimize.minimize_scalar(lambda s: least(s)[0], bounds=(0.0, np.log(LARGEST)), method="bounded")
    value, log_noise = least(0.0)
    chance = 0.5 * float(special.chdtrc(1.0, max(value - float(best.fun), 0.0)))
    return Likeness(float(np.exp(best.x)), chance, noise * float(np.exp(log_noise)))
