"""Compute the p-value of a score from the largest scores of searches on random residuals."""

from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array

RANDOM_SIGNS = "residuals with random signs"
FEWEST = 3
"""Least number of scores on random residuals for a p-value. With fewer scores, the p-value is 1."""
_EULER = 0.5772156649015329
_KURTOSIS = 5.4
_NODES = 21


@dataclass(frozen=True)
class PValue:
    """A p-value from random residuals. p: probability of a score as large under the null hypothesis. shuffles: number
    of random residuals. noun: what they are, such as permutations."""

    p: float
    shuffles: int
    noun: str = "permutations"


def chance_of(value: float, null: Array, noun: str = "permutations") -> PValue:
    """Return the p-value of a score, given the largest scores of T searches on random residuals.

    If some of the T largest scores reach `value`, the p-value is the larger of the rank (1 + count) / (1 + T) and the
    tail of the fitted distribution, otherwise the tail. With fewer than FEWEST finite scores the p-value is 1.
    """
    finite = null[np.isfinite(null)]
    if len(finite) < FEWEST or np.isnan(value):
        return PValue(1.0, len(null), noun)
    reached, tail = int(np.sum(finite >= value)), _tail(value, finite)
    return PValue(max((1 + reached) * (1.0 / (len(null) + 1)), tail) if reached else tail, len(null), noun)


def _tail(value: float, null: Array) -> float:
    """Return the tail probability of Gumbel's distribution of maxima (Gumbel 1958), fitted to T maxima under the null.

    Gumbel's scale is β = s √6 / π, with s the standard deviation of the maxima, and Gumbel's location is their mean
    minus 0.5772 β. The tail is averaged over the log-normal distribution of s of width √((κ - 1) / 4T), corrected for
    the bias 1 - (κ - 1) / 8T of s, and widened by √(1 + 1/T) for the uncertainty of the mean, with Gumbel's kurtosis κ
    = 5.4.
    """
    count = len(null)
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    spread = max(float(np.std(null, ddof=1)), 1e-6) * (1 + (_KURTOSIS - 1) / (8 * count)) * np.sqrt(1 + 1 / count)
    beta = spread * np.exp(nodes * np.sqrt((_KURTOSIS - 1) / (4 * count))) * np.sqrt(6) / np.pi
    with np.errstate(over="ignore"):
        tails = -np.expm1(-np.exp((null.mean() - value) / beta - _EULER))
    return float(weights @ tails / weights.sum())
