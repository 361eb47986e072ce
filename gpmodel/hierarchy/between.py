"""Random effects: mean and spread of a parameter between machines, and a test for outlying machines.

y_i = μ + δ_i + ε_i, δ_i ~ N(0, τ²), ε_i ~ N(0, v_i) y_i: estimate of machine i; μ, τ: mean and spread
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, special

from gpmodel.arrays import Array, Mask
from gpmodel.numerics.interval import COVERAGE, SIGNIFICANCE, holm

SMALLEST = 1e-300
"""Smallest p-value that is distinguished from zero."""

FEWEST = 4
"""Least number of machines for the test for outlying machines. With three machines, the spread of the other two has one
degree of freedom, and no deviation is improbable."""


@dataclass(frozen=True)
class TypeDistribution:
    """Distribution of a parameter between machines.

    mean, stderr: mean of the parameter over the type and its standard error.
    spread: standard deviation τ between machines.
    low, high: interval of τ with coverage COVERAGE.
    """

    mean: float
    stderr: float
    spread: float
    low: float
    high: float


Judge = Callable[[Mask], tuple[Array, Array]]
"""Test of each machine against the others, as a function of the mask of machines that are no outliers. The function
returns the deviation z of each machine from the others, and the chance (p-value) of z."""


@dataclass(frozen=True)
class Deviations:
    """Deviation of each machine from the other machines, in each parameter or block of effects: one row per machine.

    z: deviation in units of the standard deviation that the other machines imply.
    chance: probability of a deviation at least as large for any machine of a fleet without outliers.
    inside: True if the machine is no outlier.
    """

    z: Array
    chance: Array
    inside: Mask


def estimate_spread(values: Array, variances: Array) -> TypeDistribution:
    """Estimate mean and spread of a parameter from its estimates on m ≥ 2 machines with given variances.

    The variance τ² between machines solves Q(τ²) = m - 1, with Q = Σ w_i (y_i - μ)² over the estimates y_i of variance
    v_i, weights w_i = 1 / (v_i + τ²) and weighted mean μ (Paule and Mandel 1982; DerSimonian and Kacker 2007). At the
    ends of the interval of τ², Q is a quantile of χ² with m - 1 degrees of freedom (Viechtbauer 2007).
    """
    tail = (1.0 - COVERAGE) / 2.0
    quantiles = special.chdtri(len(values) - 1, [tail, 1.0 - tail])
    low, high = (float(np.sqrt(_variance(values, variances, float(q)))) for q in quantiles)
    return TypeDistribution(*_pooled(values, variances), low, high)


def _pooled(values: Array, variances: Array) -> tuple[float, float, float]:
    """Return the mean of a parameter over machines, its standard error, and the spread τ between machines."""
    variance = _variance(values, variances, len(values) - 1.0)
    mean, total, _ = _weighed(values, variances + variance)
    return mean, float(1.0 / np.sqrt(total)), float(np.sqrt(variance))


def _weighed(values: Array, variances: Array) -> tuple[float, float, float]:
    """Return the weighted mean of a parameter over machines, the sum of weights, and the weighted sum of squares Q."""
    weights = 1.0 / variances
    mean = float(weights @ values / weights.sum())
    return mean, float(weights.sum()), float(weights @ (values - mean) ** 2)


def _variance(values: Array, variances: Array, wanted: float) -> float:
    """Solve for the variance τ² between machines at which the weighted sum of squares Q is `wanted`, or zero."""
    if _weighed(values, variances)[2] <= wanted:
        return 0.0
    most = float(np.sum((values - values.mean()) ** 2) / wanted)
    root = optimize.brentq(lambda part: _weighed(values, variances + part * most)[2] - wanted, 0.0, 1.0)
    return float(root) * most


def deviations(judges: Sequence[Judge], machines: int) -> Deviations:
    """Test every machine against the other machines in every parameter or block of effects.

    The p-values (chances) are corrected for the number of machines and of parameters (Holm). While the smallest p-value
    is below SIGNIFICANCE, its machine becomes an outlier and the parameter is tested again without that machine, so
    that outliers do not mask each other. With fewer than FEWEST machines there are no outliers.
    """
    inside = np.ones((machines, len(judges)), dtype=bool)
    z, chance = np.zeros(inside.shape), np.ones(inside.shape)
    if machines < FEWEST:
        return Deviations(z, chance, inside)
    stale = list(range(len(judges)))
    while True:
        for k in stale:
            z[:, k], chance[:, k] = judges[k](inside[:, k])
        corrected = holm(chance)
        open_ones = np.where(inside & (inside.sum(axis=0) >= FEWEST), corrected, np.inf)
        i, k = (int(j) for j in np.unravel_index(int(np.argmin(open_ones)), chance.shape))
        if open_ones[i, k] >= SIGNIFICANCE:
            return Deviations(z, corrected, inside)
        inside[i, k] = False
        stale = [k]


def residual(value: float, variance: float, mean: float, prior: float, machines: int) -> tuple[float, float]:
    """Return the deviation z of a further machine from `machines` others, by mean and deviation, and its p-value."""
    z = (value - mean) / float(np.hypot(np.sqrt(variance), prior))
    return z, p_value_of(z, machines)


def p_value_of(z: float, machines: int) -> float:
    """Return the two-sided p-value of a deviation `z` from the mean of `machines` others, in units of their spread.

    The deviation has Student's t distribution with `machines` - 1 degrees of freedom.
    """
    return 2.0 * float(special.stdtr(machines - 1, -abs(z)))


def normal_score(z: float, chance: float) -> float:
    """Convert a corrected p-value to the equally improbable number of standard deviations of a normal distribution.

    The converted number has the sign of z. The number is small for machines that are no outliers.
    """
    return float(np.copysign(special.ndtri(0.5 * max(chance, SMALLEST)), z))


def deleted_residuals(values: Array, variances: Array, inside: Mask) -> tuple[Array, Array]:
    """Return the deviation z of each machine from the others, and the p-value of z, from estimates and variances.

    Each machine, with estimate y of variance v, is compared with mean μ and spread τ of the other machines that are
    `inside`: z = (y - μ) / √(v + τ² + stderr(μ)²). The deviation z has Student's t distribution with m - 2 degrees of
    freedom because τ is estimated (Viechtbauer and Cheung 2010; Higgins et al. 2009).
    """
    z, chance = np.empty(len(values)), np.empty(len(values))
    for i in range(len(values)):
        others = inside & (np.arange(len(values)) != i)
        mean, stderr, spread = _pooled(values[others], variances[others])
        z[i], chance[i] = residual(values[i], variances[i], mean, float(np.hypot(spread, stderr)), int(others.sum()))
    return z, chance
