"""The prior variance of a group of coefficients with the largest marginal likelihood."""

import numpy as np

from gpmodel.arrays import Array

DECADES = 10.0
GRID = 24
REFINEMENTS = 12
"""Range of trial prior variances in powers of ten below the largest; number of grid points in the range; number of
steps of the golden section between the neighbours of the best point, which end within 0.01 nat."""


def best(s: Array, q: Array, cap: Array) -> tuple[Array, Array]:
    """Maximise the gains of groups of effects over their prior variances, each at most cap²; return gains and
    variances. The best point of a grid in the logarithm of the variance is refined by a golden section."""
    from gpmodel.evolution.kernels.variances import largest_gains

    s, q, top = np.maximum(s, 0.0), np.ascontiguousarray(q), 2.0 * np.log(cap)
    gains, where = np.empty(len(s)), np.empty(len(s))
    largest_gains(s, q, top, DECADES * np.log(10.0) / (GRID - 1), GRID, REFINEMENTS, gains, where)
    return gains, where
