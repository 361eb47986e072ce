"""Which machine a description is of: told by where it puts its tip, whatever it and its file are called."""

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import Mechanism, closed
from gpmodel.mechanism.workspace import joint_range
from gpmodel.numerics.se3 import chain

TIP_TOLERANCE = 1e-7
"""m, by which two descriptions of one machine may differ: rounding."""


def tip_at_probe(mechanism: Mechanism) -> Array:
    """Tip (3,), m, at one oblique pose: a fingerprint of the nominal geometry up to the measured frame.

    The pose is near the middle of the limits where loops do not close at the usual one.
    """
    count = np.arange(1.0, len(mechanism.joints) + 1.0)
    q, loops = 0.1 * count[None], closed(mechanism)
    if loops is not None and not loops.closes(q)[0]:
        lower, upper = np.array([joint_range(joint) for joint in mechanism.joints]).T
        q = (0.5 * (lower + upper) + 0.01 * (upper - lower) * count)[None]
    return chain(mechanism.transforms(q))[-1][0, :3, 3]


def same_machine(tip: ArrayLike, other: ArrayLike) -> bool:
    """Whether two tips at that pose are of one machine."""
    return bool(np.allclose(tip, other, atol=TIP_TOLERANCE, rtol=0))
