"""Intervals of numbers whose standard uncertainty is itself an estimate, and chances of many tests at once."""

import numpy as np
from scipy import special

from gpmodel.arrays import Array

COVERAGE = 0.95
"""Coverage of every reported interval."""


def coverage_factor(freedom: float) -> float:
    """k of an interval ± k σ that holds COVERAGE, by Student's t of `freedom` degrees, infinite where σ is known.
    Source: JCGM 100 (2008), G.3."""
    return float(special.stdtrit(freedom, 0.5 * (1.0 + COVERAGE)))


def freedom_of_sum(deviations: Array, freedoms: Array) -> Array:
    """Degrees of freedom of √Σ u² along the first axis, of standard uncertainties u with degrees ν each:
    (Σ u²)² / Σ (u⁴ / ν). Source: Welch and Satterthwaite; JCGM 100 (2008), G.4."""
    squares = np.square(deviations)
    spread = np.sum(squares**2 / freedoms, axis=0)
    total = np.sum(squares, axis=0) ** 2
    return np.asarray(np.divide(total, spread, out=np.full(np.shape(total), np.inf), where=spread > 0))


SIGNIFICANCE = 0.01
"""Significance level after correction for all tests, as in the acceptance rule."""


def holm(chances: Array) -> Array:
    """Chances, of any shape, corrected for their number, however they depend on one another.

    Sorted upwards p_(k), k from 1: max over j up to k of min(1, (n + 1 - j) p_(j)). Source: Holm (1979).
    """
    flat = chances.ravel()
    order = np.argsort(flat)
    out = np.empty_like(flat)
    out[order] = np.minimum(1.0, np.maximum.accumulate(np.arange(len(flat), 0, -1) * flat[order]))
    return out.reshape(chances.shape)


def chance_of_ratio(ratio: float, numbers: float, freedom: float) -> float:
    """Return the chance of a mean square of `numbers` normal deviates at least `ratio` times an estimated variance.

    Its degrees of freedom are `freedom`.

    F distributed; where the variance is known, `freedom` infinite, χ² over its degrees.
    """
    if np.isinf(freedom):
        return float(special.chdtrc(numbers, ratio * numbers))
    return float(special.fdtrc(numbers, freedom, ratio))


def chance_of_less(ratio: float, numbers: float, freedom: float) -> float:
    """Return the chance of a mean square at most `ratio` times the variance; see `chance_of_ratio`."""
    if np.isinf(freedom):
        return float(special.chdtr(numbers, ratio * numbers))
    return float(special.fdtr(numbers, freedom, ratio))
