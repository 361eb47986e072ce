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
    """Return the gravity loads of SerialChain.loads: at every joint the force R' M g and the moment R' (S - M p) x g.

    M: mass beyond the joint, kg. S: first moment of the mass M about the root, kg m. R, p: rotation and origin of the
    frame after the joint's motion, in the root frame. g: acceleration of gravity.
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
    """Return the positions (poses, 3), m, in the root frame of a point (3,) fixed in `frames` (poses, 4, 4)."""
    return frames[:, :3, :3] @ point + frames[:, :3, 3]


def _weight(chain: Chain, frame: Array, mass: Array, first: Array) -> Array:
    """Return the wrench (poses, 6), N and N m, in `frame`, of the weight of masses with a first moment [kg m]."""
    moment = np.cross(first - mass[:, None] * frame[:, :3, 3], chain.gravity)
    return np.concatenate([(v[:, None] @ frame[:, :3, :3])[:, 0] for v in (mass[:, None] * chain.gravity, moment)], 1)


def unit_loads(chain: Chain, q: Array) -> dict[str, Array]:
    """Return the joint torques by the mass of each link and by unit first moments of mass (1 kg m) of each link.

    A unit first moment along axis e of a link exerts the couple e x g on every revolute joint before the link. A mass m
    at c exerts on a revolute joint at p with axis z the torque z . (c - p) x m g, and on a prismatic joint the force z
    . m g. All vectors are in the root frame; g: acceleration of gravity.
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
    """Return the generalized force (poses,) on joint j, by a couple (poses, 3) if revolute, a weight if prismatic."""
    acting = couple if chain.links[j].axis.startswith("R") else np.broadcast_to(weight, couple.shape)
    return np.asarray(np.einsum("ni,ni->n", axes[j], acting))


def _on_joints(chain: Chain, on_motions: list[Array], part: str) -> dict[str, Array]:
    """Return generalized forces (poses,) on the joint coordinates by name, from forces on the motions of links."""
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
    """A chain of links driven by the joint coordinates of a table: a Mechanism."""

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        return tuple(self._joint(column) for column in range(len(self.joint_names)))

    @property
    def bodies(self) -> dict[str, tuple[float, Array]]:
        """{slot: mass [kg] and centre of mass (3,) [m] in the frame of the slot}."""
        return {f"{link.name}.moving": (link.mass, link.com) for link in self.links if link.mass}

    def with_gravity(self, gravity: Array) -> SerialChain:
        """Return a copy of the arm with a new acceleration of gravity (3,) in the root frame, m/s²."""
        return replace(self, gravity=np.asarray(gravity, dtype=np.float64))

    def with_mass(self, mass: float, moment: Array) -> SerialChain:
        """Return the arm with a further mass, kg, and first moment (3,) in the measured frame, kg m, on the last link.

        Raises InputError if the changed last link has no mass.
        """
        last, total = self.links[-1], self.links[-1].mass + mass
        if not abs(total) > 0.0:
            raise InputError(f"{self.name}: a mass of {mass:g} kg on a last link of {last.mass:g} kg leaves no mass")
        first = last.mass * last.com + self.tool[:3, :3] @ np.asarray(moment) + mass * self.tool[:3, 3]
        return replace(self, links=(*self.links[:-1], replace(last, mass=total, com=first / total)))

    @cached_property
    def link_slots(self) -> dict[str, str]:
        """{link: frame (slot) of the last moving joint before the link}, "" for a link without one; empty if the chain
        is not from a URDF."""
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
        """Return the gravity loads on the arm at rest, one value per pose; loads, not reactions.

        torque_J: generalized force of gravity on coordinate J, N m, or N for a prismatic joint. A torque is positive if
        gravity increases the coordinate, so that `deflection = compliance * torque` has a positive compliance.
        force_J_x .. moment_J_z: wrench, N and N m, of the weight of all parts beyond joint J, at the origin and in the
        axes of the frame J.moving.
        force_base_x .. moment_base_z: wrench, N and N m, of the whole arm's weight in the root frame, about its origin.
        payload: payload mass per pose, kg, at `payload_com`. Without known masses the result is empty.
        Source: sums of weights and lever arms; recursive Newton-Euler at rest (Featherstone 2008, ch. 5) agrees.
        """
        return gravity_loads(self, q, payload)

    def unit_loads(self, q: Array) -> dict[str, Array]:
        """Return the loads by the mass and by unit first moments of mass of each link, as in WeightByPart."""
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
        return np.zeros(len(q), dtype=bool) if self._shape is None else self._shape.collides(q)

    def hides(self, q: Array, points: Array, instrument: Array) -> Mask:
        return np.zeros(len(q), dtype=bool) if self._shape is None else self._shape.hides(q, points, instrument)

    def write_urdf(self, path: Path, twists: Mapping[str, Array] | None = None) -> str:
        """Write the chain with a constant error twist at each frame (slot) as URDF; see robots.urdf_export."""
        return write_calibrated_urdf(self, twists or {}, path)


@dataclass(frozen=True, eq=False)
class Branches:
    """Several arms of a robot in one tree of links. Joints that move several arms belong to the chains of all of them.

    Order of the slots: slots of the first chain without its tool, further slots of the other chains with FRAME.tool at
    the end of each chain, and `tool` of the first chain.
    """

    name: str
    chains: tuple[SerialChain, ...]

    @cached_property
    def _own(self) -> tuple[tuple[str, ...], ...]:
        """Names, in the tree of links, of the slots (frames) of each chain."""
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
        return next(chain for chain in self.chains if chain.tool_frame == tip)

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        return tuple({joint.name: joint for chain in self.chains for joint in chain.joints}.values())

    @cached_property
    def levers(self) -> dict[str, Array]:
        """{slot: vector (3,) [m] from the preceding slot of its chain, in the frame of the slot}."""
        pairs = zip(self.chains, self._own, strict=True)
        return {
            name: links(chain)[slot]
            for chain, own in pairs
            for slot, name in zip(chain.slots[1:], own[1:], strict=True)
        }

    @cached_property
    def link_slots(self) -> dict[str, str]:
        """{link: frame of the last moving joint before the link on the longest chain}, "" for a link without one."""
        return {
            link: max((chain.link_slots[link] for chain in self.chains), key=self._depth)
            for link in self.chains[0].link_slots
        }

    def _depth(self, slot: str) -> int:
        return max((own.index(slot) for own in self._own if slot in own), default=-1)

    def transforms(self, q: Array) -> Array:
        frames: dict[str, Array] = {}
        for chain, own in zip(self.chains, self._own, strict=True):
            frames.update(zip(own, se3.chain(chain.transforms(self._of(chain, q))), strict=True))
        placed = np.array([frames[slot] for slot in self.slots])
        return np.concatenate([placed[:1], np.linalg.solve(placed[:-1], placed[1:])])

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Return the gravity loads on every joint and on the base, named as in SerialChain.loads.

        A joint bears the weight of all parts beyond the joint; tools of several arms carry no payload. Gravity loads
        are linear in the masses. The mass of a shared link counts in the first chain that contains the link.
        """
        out = dict[str, Array]()
        for chain in self._weighed_once:
            for name, values in chain.loads(self._of(chain, q), np.zeros(len(q))).items():
                out[name] = out[name] + values if name in out else values
        return out

    def unit_loads(self, q: Array) -> dict[str, Array]:
        """Return the joint torques of all arms by the mass and by unit first moments of mass of each link."""
        out = dict[str, Array]()
        for chain in self.chains:
            out |= chain.unit_loads(self._of(chain, q))
        return out

    def write_urdf(self, path: Path, twists: Mapping[str, Array] | None = None) -> str:
        """Write the arms with a constant error twist at each frame (slot) as URDF; see robots.urdf_export."""
        arms, before, given = [], set[str](), twists or {}
        for chain, own in zip(self.chains, self._own, strict=True):
            shared = before if chain.source else set()
            slots = zip(chain.slots, own, strict=True)
            arms.append((chain, {s: given[n] for s, n in slots if n in given and n not in shared}))
            before |= {*own}
        return write_arms_urdf(arms, path)

    @cached_property
    def _weighed_once(self) -> tuple[SerialChain, ...]:
        """The chains of the arms; a shared link has its mass in the first of its chains only."""
        counted, out = set[str](), []
        for chain in self.chains:
            links = (replace(link, mass=0.0) if link.name in counted else link for link in chain.links)
            out.append(replace(chain, links=tuple(links)))
            counted |= {link.name for link in chain.links}
        return tuple(out)

    def _of(self, chain: SerialChain, q: Array) -> Array:
        """Select the joint values (poses, joints) of one chain from the joint values of the tree of links."""
        names = [joint.name for joint in self.joints]
        return np.asarray(q)[:, [names.index(name) for name in chain.joint_names]]


def check_arms(chains: tuple[SerialChain, ...], where: str) -> None:
    """Raise InputError for two arms with one name, or for joints that share a name but differ between arms."""
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
