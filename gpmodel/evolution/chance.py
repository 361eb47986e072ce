"""Null distribution of a score, from the best scores on permuted residuals."""

from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array

FEWEST = 3
"""Shuffled scores below which no law can be fitted to them, and nothing is claimed."""
_EULER = 0.5772156649015329
_KURTOSIS = 5.4
_NODES = 21


@dataclass(frozen=True)
class Chance:
    """Probability `p` of reaching a score by chance, from so many `shuffles`. of: what was shuffled."""

    p: float
    shuffles: int
    of: str = "shuffles"


def chance(value: float, null: Array) -> Chance:
    """Chance of reaching `value` where nothing is, from null maxima (T,).

    Where a shuffled score reaches the value: the larger of rank (1 + count) / (1 + T) and fitted law. Beyond all of
    them the law alone. With under three finite scores: 1.
    """
    finite = null[np.isfinite(null)]
    if len(finite) < FEWEST or np.isnan(value):
        return Chance(1.0, len(null))
    reached, tail = int(np.sum(finite >= value)), _tail(value, finite)
    return Chance(max((1 + reached) * (1.0 / (len(null) + 1)), tail) if reached else tail, len(null))


def larger(first: Chance, *others: Chance) -> Chance:
    """The largest of several chances of one thing."""
    return max((first, *others), key=lambda found: found.p)


def _tail(value: float, null: Array) -> float:
    """Tail of Gumbel's law of maxima (Gumbel 1958), β = s √6 / π and μ = mean - 0.5772 β, for one further draw.

    The law is known as well as T draws tell it: s is averaged over its log-normal uncertainty √((κ - 1) / 4T), freed
    of its bias 1 - (κ - 1) / 8T and widened by √(1 + 1/T) for that of the mean; κ = 5.4, Gumbel's kurtosis.
    """
    count = len(null)
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    spread = max(float(np.std(null, ddof=1)), 1e-6) * (1 + (_KURTOSIS - 1) / (8 * count)) * np.sqrt(1 + 1 / count)
    beta = spread * np.exp(nodes * np.sqrt((_KURTOSIS - 1) / (4 * count))) * np.sqrt(6) / np.pi
    with np.errstate(over="ignore"):
        tails = -np.expm1(-np.exp((null.mean() - value) / beta - _EULER))
    return float(weights @ tails / weights.sum())
