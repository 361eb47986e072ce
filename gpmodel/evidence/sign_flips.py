"""Sign-flip test of the out-of-sample gain: a p-value without a search on permuted residuals."""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.chance import Chance

FLIPS = 9999
"""Random sign patterns; the smallest p-value is 1e-4."""

SIGN_FLIPS = "sign flips of the gain on unseen poses"
AT_ONCE = 1_000_000
"""Signs worked on at once, 8 MB."""


def sign_flip_chance(gain: Array) -> Chance:
    """One-sided p-value of a sum of gains (U,) under the hypothesis that each is symmetric about zero.

    p = (1 + reached) / (1 + flips) over random sign patterns, which is exact at any number of values: the observed
    pattern is one of them. Where a law predicts nothing, what it gains on a pose it was not fitted to is 2 r·d - d·d
    with r symmetric about zero, so that the test errs to the safe side. Source: Pesarin and Salmaso (2010), 1.9;
    Phipson and Smyth (2010) for the one that is added.
    """
    rng, total, reached = np.random.default_rng(0), float(gain.sum()), 0
    for part in np.array_split(np.arange(FLIPS), -(-FLIPS * len(gain) // AT_ONCE)):
        signs = 2.0 * rng.integers(0, 2, (len(part), len(gain))) - 1.0
        reached += int(np.sum(signs @ gain >= total))
    return Chance((1 + reached) / (1 + FLIPS), FLIPS, False, SIGN_FLIPS)
