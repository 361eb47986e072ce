"""Description length of a fit, in nats of log evidence, for programs, effects and groups."""

import numpy as np

from gpmodel.arrays import Array

ROUNDING = 1e-12
"""Relative rounding error of a sum of 1e4 squares, each of which has the relative rounding error 1e-16."""

RESOLUTION = 1e-6
"""Difference of description lengths, nats, below which two description lengths count as equal. Sums on another
processor differ by up to 1e-8."""


def fit_nats(gain: Array | float, components: float, rounding: float = ROUNDING) -> Array:
    """Return the rise of the log likelihood, nats, if a model explains a share ``gain`` of the sum of squares.

    components / 2 * -ln(1 - gain)

    components: number of measured values. The unexplained share 1 - gain is at least ``rounding``. Source: Rissanen
    (1978).
    """
    return np.asarray(-0.5 * components * np.log(np.maximum(1.0 - np.asarray(gain), rounding)))


def ranked(nats: Array | float) -> Array:
    """Round description lengths, nats, to multiples of ``RESOLUTION``, so that comparisons do not depend on rounding
    errors.

    Equivalent programs differ in the last bit of a sum, and differently on each processor.
    """
    return np.asarray(np.round(np.asarray(nats) / RESOLUTION) * RESOLUTION)


def gain_nats(gain: Array | float) -> Array:
    """Return -ln(1 - gain), rounded to RESOLUTION: log likelihood of two measured values, nats, to compare gains."""
    return ranked(fit_nats(gain, 2.0))
