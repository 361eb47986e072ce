"""Several arms on one torso: a tree of joints with a measured link on each arm, as a Mechanism and Branched."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import links
from gpmodel.mechanism.protocol import Joint
from gpmodel.numerics import se3
from robots.chain import SerialChain
from robots.urdf import read_urdf
from robots.urdf_export import write_arms_urdf


@dataclass(frozen=True, eq=False)
class Branches:
    """Chains (A,) of one tree; chains share the joints that move several arms.

    Slots are the slots of the first chain without its last, then the further slots of the other chains with FRAME.tool
    at the end of each, and `tool` of the first chain.
    """

    name: str
    chains: tuple[SerialChain, ...]

    @cached_property
    def _own(self) -> tuple[tuple[str, ...], ...]:
        """Slots of each chain, with their names in the tree."""
        ends = ("tool", *(f"{chain.tool_frame}.tool" for chain in self.chains[1:]))
        return tuple((*chain.slots[:-1], end) for chain, end in zip(self.chains, ends, strict=True))

    @cached_property
    def slots(self) -> tuple[str, ...]:
        return (*(slot for slot in dict.fromkeys(s for own in self._own for s in own) if slot != "tool"), "tool")

    @cached_property
    def parents(self) -> tuple[int, ...]:
        before = {slot: own[i - 1] if i else "" for own in self._own for i, slot in enumerate(own)}
        return tuple(self.slots.index(before[slot]) if before[slot] else -1 for slot in self.slots)

    @property
    def tips(self) -> Mapping[str, str]:
        return {chain.tool_frame: own[-1] for chain, own in zip(self.chains, self._own, strict=True)}

    def alone(self, tip: str) -> SerialChain:
        """Return the chain that ends at a measured link; see gpmodel.mechanism.branches.Branched."""
        return next(chain for chain in self.chains if chain.tool_frame == tip)

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        return tuple({joint.name: joint for chain in self.chains for joint in chain.joints}.values())

    @cached_property
    def levers(self) -> dict[str, Array]:
        """Slot -> vector (3,) from the preceding slot of its chain, in its own frame, m."""
        pairs = zip(self.chains, self._own, strict=True)
        return {
            name: links(chain)[slot]
            for chain, own in pairs
            for slot, name in zip(chain.slots[1:], own[1:], strict=True)
        }

    @cached_property
    def link_slots(self) -> dict[str, str]:
        """Link -> slot of the last motion before it, "" if the link is fixed. The longest chain to the link is used."""
        return {
            link: max((chain.link_slots[link] for chain in self.chains), key=self._depth)
            for link in self.chains[0].link_slots
        }

    def _depth(self, slot: str) -> int:
        return max((own.index(slot) for own in self._own if slot in own), default=-1)

    def transforms(self, q: Array) -> Array:
        """Return transforms (S, N, 4, 4), m, from each slot to the next in the list. q: (N, n), rad and m."""
        frames: dict[str, Array] = {}
        for chain, own in zip(self.chains, self._own, strict=True):
            frames.update(zip(own, se3.chain(chain.transforms(self._of(chain, q))), strict=True))
        placed = np.array([frames[slot] for slot in self.slots])
        return np.concatenate([placed[:1], np.linalg.solve(placed[:-1], placed[1:])])

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Return the gravity loads on every joint and on the base; see SerialChain.loads.

        Each joint bears the weight of everything it carries; the tools carry no payload. Loads are linear in the
        masses. The mass of a shared link counts in the first chain that contains it.
        """
        out = dict[str, Array]()
        for chain in self._weighed_once:
            for name, values in chain.loads(self._of(chain, q), np.zeros(len(q))).items():
                out[name] = out[name] + values if name in out else values
        return out

    def unit_loads(self, q: Array) -> dict[str, Array]:
        """Return the loads per unit moment and mass of each link; see SerialChain.unit_loads. A shared link is equal in
        all chains."""
        out = dict[str, Array]()
        for chain in self.chains:
            out |= chain.unit_loads(self._of(chain, q))
        return out

    def write_urdf(self, path: Path, twists: Mapping[str, Array] | None = None) -> str:
        """Write the arms with constant error twists, by slot, as URDF; see robots.urdf_export."""
        arms, before, given = [], set[str](), twists or {}
        for chain, own in zip(self.chains, self._own, strict=True):
            shared = before if chain.source else set()
            slots = zip(chain.slots, own, strict=True)
            arms.append((chain, {s: given[n] for s, n in slots if n in given and n not in shared}))
            before |= {*own}
        return write_arms_urdf(arms, path)

    @cached_property
    def _weighed_once(self) -> tuple[SerialChain, ...]:
        """Chains in which a link has a mass only in the first chain that contains it."""
        counted, out = set[str](), []
        for chain in self.chains:
            links = (replace(link, mass=0.0) if link.name in counted else link for link in chain.links)
            out.append(replace(chain, links=tuple(links)))
            counted |= {link.name for link in chain.links}
        return tuple(out)

    def _of(self, chain: SerialChain, q: Array) -> Array:
        """Return the joint values (N, n) of a chain, from those of the tree."""
        names = [joint.name for joint in self.joints]
        return np.asarray(q)[:, [names.index(name) for name in chain.joint_names]]


def check_arms(chains: tuple[SerialChain, ...], where: str) -> None:
    """Raise InputError for arms without different names, or for joints that share a name but differ between arms."""
    names = [chain.tool_frame for chain in chains]
    if len(set(names)) < len(names) or "" in names:
        raise InputError(f"{where}: arms {', '.join(map(repr, names))}; expected different names")
    parts: dict[str, tuple[str, ...]] = {}
    for chain in chains:
        for k, (link, limits) in enumerate(zip(chain.links, chain.limits.tolist(), strict=True)):
            before = tuple(other.name for other in chain.links[:k])
            said = (*before, link.axis, repr(np.round(link.placement, 12).tolist()), repr(limits))
            if parts.setdefault(link.name, said) != said:
                arm = chain.tool_frame
                raise InputError(
                    f"{where}: joint '{link.name}' of arm '{arm}' differs from the joint of this name in another "
                    "arm; expected equal placement, axis and limits in every arm, or another name"
                )


def read_branches(path: Path, frames: list[str], *, name: str | None = None) -> Branches:
    """Read the arms of a URDF file that end at the links `frames`.
    Raises InputError as `read_urdf`, or for a repeated link."""
    if len(set(frames)) < len(frames):
        raise InputError(f"{name or path}: frames {', '.join(frames)}; expected each link once")
    return Branches(name or path.stem, tuple(read_urdf(path, name=name, frame=frame, arms=frames) for frame in frames))
