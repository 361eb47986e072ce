"""What a fit is worth in nats: the one description length of programs, effects and groups."""

import numpy as np
from numpy.typing import NDArray

ROUNDING = 1e-12
"""Share of an energy that is not told from none: sums of 1e4 squares, each rounded at 1e-16."""


def fit_nats(gain: NDArray[np.float64] | float, components: float, rounding: float = ROUNDING) -> NDArray[np.float64]:
    """What removing a share ``gain`` of the energy of ``components`` measured values saves, nats, before any cost:

        components / 2 * -ln(1 - gain)

    with the share left never taken for less than rounding. Source: Rissanen (1978).
    """
    return np.asarray(-0.5 * components * np.log(np.maximum(1.0 - np.asarray(gain), rounding)))
