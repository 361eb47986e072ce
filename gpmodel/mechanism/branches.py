"""Mechanisms of several chains, such as two arms on one torso, each with its own measured tip."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.protocol import Joint, Mechanism, ThermalLevers, closed, unwrapped
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import chain

FREE_TURN = np.pi
FREE_TRAVEL = 0.5
"""Largest travel to each side of zero for a joint without limits, rad and m."""

MOST_DRAWS = 100
"""Largest number of random draws of joint values for each pose. The search ends if fewer than one draw in a hundred
closes the loops."""


def joint_range(joint: Joint) -> tuple[float, float]:
    """Return the limits of a joint, rad or m, reduced to one turn or one metre if the range is wider."""
    widest = FREE_TURN if joint.kind == "revolute" else FREE_TRAVEL
    if joint.upper - joint.lower <= 2 * widest:
        return joint.lower, joint.upper
    if joint.lower <= -widest and joint.upper >= widest:
        return -widest, widest
    return (
        (joint.upper - 2 * widest, joint.upper) if np.isfinite(joint.upper) else (joint.lower, joint.lower + 2 * widest)
    )


def ranges(mechanism: Mechanism, measured: Array | None = None) -> tuple[Array, Array]:
    """Return lower and upper limits of the joints, rad and m. For a joint without limits, the measured range of its
    values is returned."""
    lower, upper = np.array([joint_range(j) for j in mechanism.joints]).T
    if measured is None or not len(measured):
        return lower, upper
    free = np.array([not np.isfinite([j.lower, j.upper]).all() for j in mechanism.joints])
    return np.where(free, measured.min(axis=0), lower), np.where(free, measured.max(axis=0), upper)


def random_poses(mechanism: Mechanism, count: int, rng: np.random.Generator, measured: Array | None = None) -> Array:
    """Return random joint values (count, joints), rad and m, uniform within the limits, at which closed loops close.

    measured: joint values (poses, joints) whose range replaces limits that a joint does not have.
    """
    return drawn_between(mechanism, *ranges(mechanism, measured), count, rng)


def drawn_between(mechanism: Mechanism, lower: Array, upper: Array, count: int, rng: np.random.Generator) -> Array:
    """Return random joint values (count, joints), uniform between `lower` and `upper`, at which closed loops close.

    Raises InputError if hardly any draw closes the loops.
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
    """Return {slot: vector (3,) [m] from the previous slot, in the frame of the slot}: lengths that grow with
    temperature.

    A mechanism with ThermalLevers states its vectors itself, such as a joint whose lever a first fit determines.
    """
    if isinstance(mechanism, ThermalLevers):
        return mechanism.levers
    rest = mechanism.transforms(np.zeros((1, len(mechanism.joints))))[:, 0, :3, :]
    return {slot: f[:, :3].T @ f[:, 3] for slot, f in zip(mechanism.slots[1:], rest[1:], strict=True)}


TIP_TOLERANCE = 1e-7
"""Largest distance, m, between the tips of two descriptions that count as one machine: a rounding error."""


def trial_pose(mechanism: Mechanism) -> Array:
    """Return one trial pose (1, joints) with all joints off zero; if closed loops do not close at this pose, a pose
    near the middle of the limits."""
    count = np.arange(1.0, len(mechanism.joints) + 1.0)
    q, loops = 0.1 * count[None], closed(mechanism)
    if loops is not None and not loops.closes(q)[0]:
        lower, upper = np.array([joint_range(joint) for joint in mechanism.joints]).T
        q = (0.5 * (lower + upper) + 0.01 * (upper - lower) * count)[None]
    return q


def tip_at_trial(mechanism: Mechanism) -> Array:
    """Return the tip (3,), m, of the mechanism at one trial pose, which identifies its nominal geometry."""
    return np.asarray(chain(mechanism.transforms(trial_pose(mechanism)))[-1][0, :3, 3])


def same_machine(tip: ArrayLike, other: ArrayLike) -> bool:
    """Return whether two tip positions at one trial pose belong to one machine."""
    return bool(np.allclose(tip, other, atol=TIP_TOLERANCE, rtol=0))


@runtime_checkable
class Branched(Protocol):
    """A mechanism of several kinematic chains. `slots` lists the frames at which errors act (slots), chain by chain.

    `transforms` gives each slot in the frame of the previous slot of the list `slots`. An error moves only later slots
    (frames) of its chain.
    """

    @property
    def slots(self) -> tuple[str, ...]:
        """Names of the slots (frames at which errors act) of all chains."""

    @property
    def parents(self) -> tuple[int, ...]:
        """Index in `slots` of the previous frame (slot) of each frame on its chain; -1 for the first frame of all
        chains."""

    @property
    def tips(self) -> Mapping[str, str]:
        """{measured link: frame (slot) that carries the link}. The first measured link is the default."""

    def alone(self, tip: str) -> Mechanism:
        """Return the chain that ends at the measured link `tip` as a mechanism. The frames (slots) of the chain keep
        their names, except the last slot, which becomes `tool`."""


def branched(mechanism: Mechanism) -> Branched | None:
    """Return the mechanism, or the mechanism inside a loaded mechanism, if it has several chains, else None."""
    bare = unwrapped(mechanism)
    return bare if isinstance(bare, Branched) else None


def mounting_slots(tree: Branched) -> list[int]:
    """Return the indices in `slots` of frames that carry an arm and on which a further arm is mounted.

    The first arm at each frame (slot) is not listed, nor are measured tips, whose slot is the tool.
    """
    tips = [*tree.tips.values()]
    found = [i for i, parent in enumerate(tree.parents) if parent >= 0 and parent in tree.parents[:i]]
    return [i for i in found if tree.slots[i] not in tips]


def moves_with(mechanism: Mechanism) -> Mask:
    """Return a mask (slots, slots): True if an error at the first slot moves the frame of the second, a later slot of
    the first one's chain or the slot itself."""
    tree, count = branched(mechanism), len(mechanism.slots)
    if tree is None:
        return np.triu(np.ones((count, count), dtype=bool))
    out = np.eye(count, dtype=bool)
    for slot, parent in enumerate(tree.parents):
        if parent >= 0:
            out[:, slot] |= out[:, parent]
    return out


def assembled(tree: Branched, transforms: Array, errors: Mapping[int, Array]) -> Array:
    """Return the poses (slots, poses, 4, 4) of all slots in the root frame, m, each after its own error.

    transforms: nominal transforms between successive frames (slots). errors: {frame index: transforms (poses, 4, 4)}.
    """
    nominal = se3.chain(transforms)
    out = np.empty_like(nominal)
    for slot, parent in enumerate(tree.parents):
        frame = nominal[slot] if parent < 0 else out[parent] @ np.linalg.solve(nominal[parent], nominal[slot])
        out[slot] = frame @ errors[slot] if slot in errors else frame
    return out


WORLD = ("world", "base")
"""Names of the stationary frames, such as "world"."""


@runtime_checkable
class Linked(Protocol):
    """A mechanism whose links have names."""

    @property
    def link_slots(self) -> Mapping[str, str]:
        """{link: slot to whose frame the link is fixed}, an empty text for a stationary link."""


def carrier_slot(mechanism: Mechanism, link: str, where: str) -> int:
    """Return the position in `slots` of the frame of the chain that carries a link, -1 for a stationary link.

    link: "world", "tool", the name of a joint for the part beyond it, or the name of a link or an arm. With closed
    loops only "world", "base" and "tool" are known. where: location of the name in the message. Raises InputError for
    an unknown name.
    """
    bare = unwrapped(mechanism)
    known = {**dict.fromkeys(WORLD, ""), "tool": "tool"}
    if not closed(mechanism):
        own = dict(bare.link_slots) if isinstance(bare, Linked) else {}
        tree = branched(mechanism)
        own |= tree.tips if tree else {}
        known = {**own, **{joint.name: f"{joint.name}.moving" for joint in mechanism.joints}, **known}
    if link not in known:
        raise InputError(f"{where}: link '{link}' is unknown; expected {choices(link, ['world', *known])}")
    return mechanism.slots.index(known[link]) if known[link] else -1
