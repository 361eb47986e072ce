"""How likely a score is by chance, from the best scores on shuffled residuals."""

import numpy as np
from scipy import stats

from gpmodel.arrays import Array


def chance(value: float, null: Array) -> float:
    """Probability of reaching `value` by chance from null maxima: the larger of rank count and Gumbel tail.

    The Gumbel law of maxima is fitted by moments: β = s √6 / π, μ = mean - 0.5772 β.
    """
    if len(null) == 0:
        return 1.0
    finite = null[np.isfinite(null)]
    if len(finite) < 3:
        return 0.5
    rank = (1 + np.sum(finite >= value)) / (len(finite) + 1)
    beta = max(float(np.std(finite, ddof=1)) * np.sqrt(6) / np.pi, 1e-6)
    with np.errstate(over="ignore"):
        tail = float(stats.gumbel_r.sf(value, finite.mean() - 0.5772 * beta, beta))
    return tail if np.sum(finite >= value) == 0 else float(max(rank, tail))
