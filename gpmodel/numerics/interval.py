"""Intervals of numbers whose standard uncertainty is itself an estimate."""

import numpy as np
from scipy import special

from gpmodel.arrays import Array

COVERAGE = 0.95
"""Of every interval that is stated."""


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
    return np.divide(total, spread, out=np.full(np.shape(total), np.inf), where=spread > 0)
