"""Description length of a fit in nats, for programs, effects and groups."""

import numpy as np

from gpmodel.arrays import Array

ROUNDING = 1e-12
"""Share of an energy that is not told from none: sums of 1e4 squares, each rounded at 1e-16."""

RESOLUTION = 1e-6
"""Nats within which lengths are equal: another processor's sums move one by up to 1e-8."""


def fit_nats(gain: Array | float, components: float, rounding: float = ROUNDING) -> Array:
    """Return the gain of removing a share ``gain`` of the energy of ``components`` measured values, nats, without
    any price:

        components / 2 * -ln(1 - gain)

    with the share left never taken for less than rounding. Source: Rissanen (1978).
    """
    return np.asarray(-0.5 * components * np.log(np.maximum(1.0 - np.asarray(gain), rounding)))


def ranked(nats: Array | float) -> Array:
    """Lengths in nats as they are compared, in whole steps of ``RESOLUTION``, so that among equals their order decides.

    Two programs that say the same differ in the last bit of a sum, on one processor in the one sense, on another in the
    other; what is bred from them must not.
    """
    return np.asarray(np.round(np.asarray(nats) / RESOLUTION) * RESOLUTION)


def gain_nats(gain: Array | float) -> Array:
    """A gain as gains are compared: -ln(1 - gain), the nats of two measured values, ``ranked``."""
    return ranked(fit_nats(gain, 2.0))
