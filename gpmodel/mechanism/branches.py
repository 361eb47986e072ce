"""Mechanisms of several chains: two arms on one torso, each with a tip of its own."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.protocol import Joint, Levered, Mechanism, bare_of, closed
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import chain

FREE_TURN = np.pi
FREE_TRAVEL = 0.5
"""Travel to each side of a joint without limits, radians and metres."""

MOST_DRAWS = 100
"""Random joint values drawn for each pose at most. If fewer than one in a hundred closes the loops, the search ends."""


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
"""Largest distance between the tips of two descriptions of one machine, m: rounding."""


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


@runtime_checkable
class Branched(Protocol):
    """A mechanism whose slots are those of several chains, one after the other. `transforms` leads from each slot to
    the next in that list; an error moves only what its own chain carries."""

    @property
    def slots(self) -> tuple[str, ...]:
        """See Mechanism."""

    @property
    def parents(self) -> tuple[int, ...]:
        """The slot before each on its own chain, by index; -1 for the first, which all share."""

    @property
    def tips(self) -> Mapping[str, str]:
        """Measured link -> the slot that carries it; the first is the one a row reads that names none."""

    def alone(self, tip: str) -> Mechanism:
        """The chain that ends at a measured link, alone: its slots by their names here, but the last, `tool`."""


def branched(mechanism: Mechanism) -> Branched | None:
    """The mechanism, or what it was loaded from, where it has several chains; None of a single one."""
    bare = bare_of(mechanism)
    return bare if isinstance(bare, Branched) else None


def stands(tree: Branched) -> list[int]:
    """Slots, by index, at which an arm stands beside another on what both share: of each place all but the first, and
    none of a tip, which the tool places."""
    tips = [*tree.tips.values()]
    found = [i for i, parent in enumerate(tree.parents) if parent >= 0 and parent in tree.parents[:i]]
    return [i for i in found if tree.slots[i] not in tips]


def lineage(mechanism: Mechanism) -> Mask:
    """Return whether an error at one slot moves the frame of another (S, S): the slot itself or a later one of its
    chain.
    """
    tree, count = branched(mechanism), len(mechanism.slots)
    if tree is None:
        return np.triu(np.ones((count, count), dtype=bool))
    out = np.eye(count, dtype=bool)
    for slot, parent in enumerate(tree.parents):
        if parent >= 0:
            out[:, slot] |= out[:, parent]
    return out


def assembled(tree: Branched, transforms: Array, errors: Mapping[int, Array]) -> Array:
    """Frames (S, N, 4, 4) in the root, m, each after its own error (N, 4, 4), by the index of its slot.

    transforms: (S, N, 4, 4) from each slot to the next in the list.
    """
    nominal = se3.chain(transforms)
    out = np.empty_like(nominal)
    for slot, parent in enumerate(tree.parents):
        frame = nominal[slot] if parent < 0 else out[parent] @ np.linalg.solve(nominal[parent], nominal[slot])
        out[slot] = frame @ errors[slot] if slot in errors else frame
    return out


WORLD = ("world", "base")
"""Names of the stationary frames."""


@runtime_checkable
class Linked(Protocol):
    """A mechanism whose links have names of their own."""

    @property
    def link_slots(self) -> Mapping[str, str]:
        """Link -> the slot whose frame it is fixed to; the empty text where it stands still."""


def carrier_slot(mechanism: Mechanism, link: str, where: str) -> int:
    """Index of the slot that carries a link, -1 of what stands still.

    link: "world", "tool", a joint's name for the part beyond it, the name of a link or of an arm. Raises InputError,
    saying `where` it is written, for another; and for a link of a mechanism with closed loops other than these two.
    """
    bare = bare_of(mechanism)
    known = {**dict.fromkeys(WORLD, ""), "tool": "tool"}
    if not closed(mechanism):
        own = dict(bare.link_slots) if isinstance(bare, Linked) else {}
        tree = branched(mechanism)
        own |= tree.tips if tree else {}
        known = {**own, **{joint.name: f"{joint.name}.moving" for joint in mechanism.joints}, **known}
    if link not in known:
        raise InputError(f"{where}: link '{link}' is unknown; expected {choices(link, ['world', *known])}")
    return mechanism.slots.index(known[link]) if known[link] else -1
