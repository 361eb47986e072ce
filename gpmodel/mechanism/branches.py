"""Mechanisms of several chains: two arms on one torso, each with a tip of its own."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.protocol import Mechanism, bare_of, closed
from gpmodel.numerics import se3


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
        """The chain that ends at a measured link, by itself: its slots by their names here, but the last, `tool`."""


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
