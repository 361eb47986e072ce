"""Mechanisms of revolute and prismatic joints: a serial chain, and several arms on one torso."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.arrays import ROUNDING, Array, Mask
from gpmodel.errors import InputError
from gpmodel.extras import extra_for
from gpmodel.mechanism.branches import links
from gpmodel.mechanism.protocol import AXES, Joint
from gpmodel.numerics import se3
from gpmodel.table.units import identifier
from robots.links import Chain
from robots.urdf_export import write_arms_urdf, write_calibrated_urdf
from robots.urdf_tree import has_geometry, read_tree

if TYPE_CHECKING:
    from robots.collision import Shape


_COMPONENTS = ("force_{}_x", "force_{}_y", "force_{}_z", "moment_{}_x", "moment_{}_y", "moment_{}_z")


def gravity_loads(chain: Chain, q: Array, payload: Array) -> dict[str, Array]:
    """Return SerialChain.loads: force R' M g and moment R' (S - M p) x g at every joint.

    M (N,) is the mass beyond the joint, kg, and S (N, 3) its first moment about the root, kg m. R and p are orientation
    and origin of the frame after the joint's motion, in the root frame.
    """
    payload = np.asarray(payload, dtype=np.float64)
    if not any(link.mass for link in chain.links) and not np.any(payload):
        return {}
    frames = se3.chain(chain.transforms(q))
    mass = np.broadcast_to(payload, len(frames[0]))
    first = mass[:, None] * _points(frames[-1], chain.payload_com)
    wrenches = []
    for link, frame in zip(reversed(chain.links), reversed(frames[2:-1:2]), strict=True):
        mass, first = mass + link.mass, first + link.mass * _points(frame, link.com)
        wrenches.append(_weight(chain, frame, mass, first))
    wrenches.append(_weight(chain, frames[0], mass, first))
    return _named(chain, np.stack(wrenches[::-1], axis=1))


def _points(frames: Array, point: Array) -> Array:
    """Return a point (3,), fixed in frames (N, 4, 4), in the root frame (N, 3), m."""
    return frames[:, :3, :3] @ point + frames[:, :3, 3]


def _weight(chain: Chain, frame: Array, mass: Array, first: Array) -> Array:
    """Return the wrench (N, 6), N and N m, of a mass (N,) with first moment (N, 3), in a frame (N, 4, 4)."""
    moment = np.cross(first - mass[:, None] * frame[:, :3, 3], chain.gravity)
    return np.concatenate([(v[:, None] @ frame[:, :3, :3])[:, 0] for v in (mass[:, None] * chain.gravity, moment)], 1)


def unit_loads(chain: Chain, q: Array) -> dict[str, Array]:
    """Return the joint torques by a unit mass and unit first moments of mass of each link.

    A first moment e_a of link k exerts the couple (R_k e_a) x g on every revolute joint j <= k. A mass m at c exerts
    the torque z_j . (c - p_j) x m g on a revolute joint, and the force z_j . m g on a prismatic joint. All vectors are
    in the root frame.
    """
    frames = se3.chain(chain.transforms(q))[2:-1:2]
    axes = [frames[j][:, :3, AXES.index(link.axis) % 3] for j, link in enumerate(chain.links)]
    out: dict[str, Array] = {}
    for k, link in enumerate(chain.links):
        for a, side in enumerate("xyz"):
            couple = np.cross(frames[k][:, :3, a], chain.gravity)
            turned = [_on_motion(chain, axes, j, couple) for j in range(k + 1)]
            out |= _on_joints(chain, turned, f"{link.name}_{side}")
            out |= {f"moment_base_{b}_of_{link.name}_{side}": couple[:, i] for i, b in enumerate("xyz")}
        weight = link.mass * chain.gravity
        centre = _points(frames[k], link.com)
        couples = [np.cross(centre - frames[j][:, :3, 3], weight) for j in range(k + 1)]
        out |= _on_joints(chain, [_on_motion(chain, axes, j, c, weight) for j, c in enumerate(couples)], link.name)
    return {name: values for name, values in out.items() if np.any(np.abs(values) > ROUNDING)}


def _on_motion(chain: Chain, axes: list[Array], j: int, couple: Array, weight: Array | float = 0.0) -> Array:
    """Return the generalized force (N,) on motion j by a couple (N, 3) if revolute, by a weight (3,) if prismatic."""
    acting = couple if chain.links[j].axis.startswith("R") else np.broadcast_to(weight, couple.shape)
    return np.asarray(np.einsum("ni,ni->n", axes[j], acting))


def _on_joints(chain: Chain, on_motions: list[Array], part: str) -> dict[str, Array]:
    """Return generalized forces (N,) on the joint coordinates, from forces on the first motions (else zero)."""
    torques = np.stack(on_motions, axis=1) @ chain.coupling[: len(on_motions)]
    return {f"torque_{name}_of_{part}": torques[:, c] for c, name in enumerate(chain.joint_names)}


def _named(chain: Chain, wrenches: Array) -> dict[str, Array]:
    along = [wrenches[:, i + 1, AXES.index(link.axis)] for i, link in enumerate(chain.links)]
    torques = np.stack(along, axis=1) @ chain.coupling
    named = {f"torque_{name}": torques[:, column] for column, name in enumerate(chain.joint_names)}
    for i, name in enumerate(("base", *(link.name for link in chain.links))):
        named |= {text.format(name): wrenches[:, i, k] for k, text in enumerate(_COMPONENTS)}
    return named


@dataclass(frozen=True, eq=False)
class SerialChain(Chain):
    """A chain of links driven by table coordinates: a Mechanism."""

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        return tuple(self._joint(column) for column in range(len(self.joint_names)))

    @property
    def bodies(self) -> dict[str, tuple[float, Array]]:
        """Slot -> mass, kg, and centre of mass (3,) in the frame of the slot, m."""
        return {f"{link.name}.moving": (link.mass, link.com) for link in self.links if link.mass}

    @cached_property
    def link_slots(self) -> dict[str, str]:
        """Link -> slot of the last motion before the link, "" for a fixed link; empty for a chain that is not from a
        URDF."""
        if self.source is None:
            return {}
        tree, own = read_tree(self.source), [link.name for link in self.links]
        out = {}
        for link in tree.frames:
            before = [name for j in tree.route(link) if (name := identifier(j.name)) in own]
            out[link] = f"{before[-1]}.moving" if before else ""
        return out

    def _joint(self, column: int) -> Joint:
        weights = self.coupling[:, column]
        drive = tuple(
            (f"{link.name}.moving", link.axis, float(weight))
            for link, weight in zip(self.links, weights, strict=True)
            if weight
        )
        own = next((axis for slot, axis, _ in drive if slot == f"{self.joint_names[column]}.moving"), drive[0][1])
        kind = "revolute" if own.startswith("R") else "prismatic"
        lower, upper = (float(limit) for limit in self.limits[column])
        return Joint(self.joint_names[column], kind, lower, upper, drive)

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Return the gravity loads (N,) on the arm at rest: the loads, not the reactions.

        torque_J (Nm; N for a prismatic joint): generalized force of gravity on the coordinate J, positive if gravity
        increases the coordinate, so that `deflection = compliance * torque` has a positive compliance.
        force_J_x .. moment_J_z (N, Nm): wrench of the weight of everything beyond J, at the origin of J.moving, in its
        axes.
        force_base_x .. moment_base_z: wrench of the whole arm in the root frame, about its origin.
        payload: (N,) kg at `payload_com`.
        The result is empty without masses. Source: sums of weights and lever arms; recursive Newton-Euler at rest
        (Featherstone 2008, ch. 5) agrees.
        """
        return gravity_loads(self, q, payload)

    def unit_loads(self, q: Array) -> dict[str, Array]:
        """Return the loads of unit first moments and of the mass of each link, as defined by `Weighed`."""
        return unit_loads(self, q)

    @cached_property
    def _shape(self) -> Shape | None:
        if self.source is None or not has_geometry(self.source):
            return None
        with extra_for("where the arm meets itself"):
            from robots.collision import Shape

        return Shape.read(self.source, self.joint_names, self.tool_frame)

    @property
    def has_shape(self) -> bool:
        """True if the URDF has collision geometry with existing meshes."""
        return self._shape is not None

    def collides(self, q: Array) -> Mask:
        """Return a mask (N,): True if the arm collides with itself at joint values (N, n); False without a shape."""
        return np.zeros(len(q), dtype=bool) if self._shape is None else self._shape.collides(q)

    def hides(self, q: Array, points: Array, instrument: Array) -> Mask:
        """Return a mask (N,): True if the arm blocks the line from points (N, 3), m, to the instrument (3,), m."""
        return np.zeros(len(q), dtype=bool) if self._shape is None else self._shape.hides(q, points, instrument)

    def write_urdf(self, path: Path, twists: Mapping[str, Array] | None = None) -> str:
        """Write the chain with constant error twists, by slot, as URDF; see robots.urdf_export."""
        return write_calibrated_urdf(self, twists or {}, path)


@dataclass(frozen=True, eq=False)
class Branches:
    """Chains (A,) of one tree; chains share the joints that move several arms.

    The slots are: slots of the first chain without the last, further slots of the other chains with FRAME.tool at the
    end of each chain, and `tool` of the first chain.
    """

    name: str
    chains: tuple[SerialChain, ...]

    @cached_property
    def _own(self) -> tuple[tuple[str, ...], ...]:
        """Slots of each chain, with the names of the slots in the tree."""
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
        """Link -> slot of the last motion before the link, "" for a fixed link, along the longest chain to the link."""
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

        Each joint bears the weight of all parts beyond the joint; the tools carry no payload. Loads are linear in the
        masses. The mass of a shared link counts in the first chain that contains it.
        """
        out = dict[str, Array]()
        for chain in self._weighed_once:
            for name, values in chain.loads(self._of(chain, q), np.zeros(len(q))).items():
                out[name] = out[name] + values if name in out else values
        return out

    def unit_loads(self, q: Array) -> dict[str, Array]:
        """Return the loads per unit moment and mass of each link; see SerialChain.unit_loads."""
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
        """Return the joint values (N, n) of a chain, from the joint values of the tree."""
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
