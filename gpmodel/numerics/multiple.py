"""Chances of many tests at once."""

import numpy as np
from scipy import special

from gpmodel.arrays import Array

SIGNIFICANCE = 0.01
"""What is beyond chance is below this, after correction for all that was looked at: as in the acceptance rule."""


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
    """Of a mean square of `numbers` normal deviates this many times a variance estimated with `freedom`, or more.

    F distributed; where the variance is known, `freedom` infinite, χ² over its degrees.
    """
    if np.isinf(freedom):
        return float(special.chdtrc(numbers, ratio * numbers))
    return float(special.fdtrc(numbers, freedom, ratio))
