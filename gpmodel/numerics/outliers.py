"""The one rule for what stands far out."""

import numpy as np
from scipy.spatial import cKDTree

from gpmodel.arrays import Array, Mask

OUTLIER_SIGMAS = 6.0
"""Robust standard deviations beyond which an error is an outlier: of the lengths of 3-D normal errors, one in 10⁵."""

OUTLIER_SHARE = 0.15
"""At most this share of the poses is left out of a fit: more are no outliers but another model."""

SMALLEST_SPREAD = 1e-9
"""Metres: exact tables have no outliers of rounding."""


NEIGHBOURS = 5
"""Poses beside one that are asked whether they stand far out as well: of every fiftieth pose at random three do so once
in ten thousand."""

ALIKE = 0.5
"""Cosine between errors that point the same way: a quarter of all directions."""

MAD_SIGMAS = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""


def outlier_limit(errors: Array, sigmas: float = OUTLIER_SIGMAS) -> float:
    """Length beyond which one of the errors (N,) is an outlier: median + sigmas · 1.4826 · MAD."""
    middle = float(np.median(errors))
    return middle + sigmas * max(MAD_SIGMAS * float(np.median(np.abs(errors - middle))), SMALLEST_SPREAD)


def among_worst(errors: Array, spared: int = 0) -> Mask:
    """The largest of the errors (N,): OUTLIER_SHARE of them, one at least, less those spared already."""
    most = max(1, int(OUTLIER_SHARE * len(errors))) - spared
    return np.isin(np.arange(len(errors)), np.argsort(errors)[::-1][:most])


def in_company(far: Mask, places: Array, errors: Array) -> Mask:
    """Those (N,) that stand far out with most of their nearest NEIGHBOURS, the same way: there the model is wrong, not
    the measurement, and leaving them out would hide it.

    places: (N, n), compared over their ranges. errors: (N, m), NaN where nothing was measured.
    """
    company = np.zeros(len(far), dtype=bool)
    span = np.ptp(places, axis=0)
    if not far.any() or len(far) <= 2 * NEIGHBOURS or not (span > 0).any():
        return company
    scaled = places[:, span > 0] / span[span > 0]
    beside = cKDTree(scaled).query(scaled[far], NEIGHBOURS + 1)[1][:, 1:]
    known = np.nan_to_num(errors)
    unit = known / np.maximum(np.linalg.norm(known, axis=1), SMALLEST_SPREAD)[:, None]
    alike = np.einsum("fm,fkm->fk", unit[far], unit[beside]) > ALIKE
    company[far] = 2 * (alike & far[beside]).sum(axis=1) > NEIGHBOURS
    return company
