"""What a mechanism spans: random poses within its limits, and its links."""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import Joint, Levered, Mechanism

FREE_TURN = np.pi
FREE_TRAVEL = 0.5
"""Radians and metres to each side that an unlimited joint is taken to move: all directions, and the room of a
machine."""


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


def links(mechanism: Mechanism) -> dict[str, Array]:
    """Slot -> the vector (3,), m, from the slot before to it, in its own frame: what grows with temperature.

    A Levered mechanism states its own, as a joint whose lever a first fit has found.
    """
    if isinstance(mechanism, Levered):
        return mechanism.levers
    rest = mechanism.transforms(np.zeros((1, len(mechanism.joints))))[:, 0, :3, :]
    return {slot: f[:, :3].T @ f[:, 3] for slot, f in zip(mechanism.slots[1:], rest[1:], strict=True)}
