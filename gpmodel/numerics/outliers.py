"""The one rule for what stands far out."""

import numpy as np

from gpmodel.arrays import Array

OUTLIER_SIGMAS = 6.0
"""Robust standard deviations beyond which an error is an outlier: of the lengths of 3-D normal errors, one in 10⁵."""

OUTLIER_SHARE = 0.1
"""At most this share of the poses is left out of a fit: more are no outliers but another model."""

SMALLEST_SPREAD = 1e-9
"""Metres: exact tables have no outliers of rounding."""


MAD_SIGMAS = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""


def outlier_limit(errors: Array, sigmas: float = OUTLIER_SIGMAS) -> float:
    """Length beyond which one of the errors (N,) is an outlier: median + sigmas · 1.4826 · MAD."""
    middle = float(np.median(errors))
    return middle + sigmas * max(MAD_SIGMAS * float(np.median(np.abs(errors - middle))), SMALLEST_SPREAD)
