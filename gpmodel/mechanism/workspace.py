"""Workspace of a mechanism: random poses within its limits, its links, and the tip position that identifies it."""

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Joint, Levered, Mechanism, closed
from gpmodel.numerics.se3 import chain

FREE_TURN = np.pi
FREE_TRAVEL = 0.5
"""Radians and metres to each side that an unlimited joint is taken to move: all directions, and the room of a
machine."""

MOST_DRAWS = 100
"""Times as many random joint values as are asked for: where one in a hundred closes, hardly any machine does."""


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
    """Joint values (count, n), uniform within the limits, rad and m; where loops close alone."""
    lower, upper = np.array([joint_range(j) for j in mechanism.joints]).T
    return drawn_between(mechanism, lower, upper, count, rng)


def drawn_between(mechanism: Mechanism, lower: Array, upper: Array, count: int, rng: np.random.Generator) -> Array:
    """Joint values (count, n), uniform between two (n,), of a machine with loops those at which these close.

    Raises InputError where hardly any do.
    """
    loops, found = closed(mechanism), np.zeros((0, len(lower)))
    batch = count if loops is None else max(count, MOST_DRAWS)
    for _ in range(MOST_DRAWS):
        q = rng.uniform(lower, upper, (batch, len(lower)))
        found = np.concatenate([found, q if loops is None else q[loops.closes(q)]])
        if len(found) >= count:
            return found[:count]
    raise InputError(f"{mechanism.name}: its loops close at {len(found)} of {MOST_DRAWS * batch} random poses within "
                     "the limits; expected narrower limits")  # fmt: skip


def links(mechanism: Mechanism) -> dict[str, Array]:
    """Slot -> the vector (3,), m, from the slot before to it, in its own frame: what grows with temperature.

    A Levered mechanism states its own, as a joint whose lever a first fit has found.
    """
    if isinstance(mechanism, Levered):
        return mechanism.levers
    rest = mechanism.transforms(np.zeros((1, len(mechanism.joints))))[:, 0, :3, :]
    return {slot: f[:, :3].T @ f[:, 3] for slot, f in zip(mechanism.slots[1:], rest[1:], strict=True)}


TIP_TOLERANCE = 1e-7
"""m, by which two descriptions of one machine may differ: rounding."""


def probe(mechanism: Mechanism) -> Array:
    """One oblique pose (1, n); near the middle of the limits where loops do not close at the usual one."""
    count = np.arange(1.0, len(mechanism.joints) + 1.0)
    q, loops = 0.1 * count[None], closed(mechanism)
    if loops is not None and not loops.closes(q)[0]:
        lower, upper = np.array([joint_range(joint) for joint in mechanism.joints]).T
        q = (0.5 * (lower + upper) + 0.01 * (upper - lower) * count)[None]
    return q


def tip_at_probe(mechanism: Mechanism) -> Array:
    """Tip (3,), m, at that pose: a fingerprint of the nominal geometry up to the measured frame."""
    return np.asarray(chain(mechanism.transforms(probe(mechanism)))[-1][0, :3, 3])


def same_machine(tip: ArrayLike, other: ArrayLike) -> bool:
    """Return whether two tip positions at the probe pose belong to one machine."""
    return bool(np.allclose(tip, other, atol=TIP_TOLERANCE, rtol=0))
