"""Which slot carries what is mounted on a link: a camera, a board, an inclinometer."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from gpmodel.errors import InputError
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Mechanism, bare_of, closed

WORLD = ("world", "base")
"""What stands still."""


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
        raise InputError(f"{where}: link '{link}' is unknown; expected {', '.join(dict.fromkeys(['world', *known]))}")
    return mechanism.slots.index(known[link]) if known[link] else -1
