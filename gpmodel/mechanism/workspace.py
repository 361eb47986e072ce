"""Random poses within the limits of a mechanism."""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import Joint, Mechanism

FREE_TURN = np.pi
FREE_TRAVEL = 0.5


def joint_range(joint: Joint) -> tuple[float, float]:
    """Limits of a joint, rad or m; at most half a turn to each side, or half a metre where nothing limits it."""
    widest = FREE_TURN if joint.kind == "revolute" else FREE_TRAVEL
    if joint.upper - joint.lower <= 2 * widest:
        return joint.lower, joint.upper
    if joint.lower <= -widest and joint.upper >= widest:
        return -widest, widest
    return (
        (joint.upper - 2 * widest, joint.upper) if np.isfinite(joint.upper) else (joint.lower, joint.lower + 2 * widest)
    )


def random_poses(mechanism: Mechanism, count: int, rng: np.random.Generator) -> Array:
    """Joint values (count, n), uniform within the limits, rad and m."""
    lower, upper = np.array([joint_range(j) for j in mechanism.joints]).T
    return rng.uniform(lower, upper, (count, len(mechanism.joints)))
