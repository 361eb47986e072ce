"""Read serial chains from URDF files, without meshes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.protocol import AXES
from gpmodel.numerics import se3
from gpmodel.table.units import identifier
from robots.chain import Branches, SerialChain
from robots.links import LONGEST_CHAIN, Link, along
from robots.urdf_tree import MOVING, UrdfJoint, UrdfTree, read_tree

FINGER_DEPTH = 3
ARM_DEPTH = 3
MOST_TURN = 30.0
"""Limit of a joint, rad, beyond which its unit is probably degrees: cables allow at most five turns either way."""


def read_urdf(
    path: Path, *, name: str | None = None, frame: str | None = None, arms: Sequence[str] = ()
) -> SerialChain:
    """Read the chain of a URDF file from its root link to the link `frame` (default: `default_frame`).

    name: name of the chain; by default the name of the <robot>, or of the file.
    arms: measured links of the other arms; the weight of the other arms is not included in this chain. The joints of
    the chain are its revolute, continuous and prismatic joints; mimic joints follow the leading joint. Joints off the
    chain stay at their neutral value, and their links weigh on the chain. If a joint axis is not a coordinate axis,
    the frames of the slots are rotated so that the joint axis is z.
    Raises InputError if the file is unreadable as URDF, `frame` is not a link beyond a moving joint, or a joint of the
    chain is floating or planar.
    """
    tree = read_tree(path)
    frame = default_frame(tree) if frame is None else frame
    if frame not in tree.frames:
        raise InputError(f"{name or path}: no link named {frame!r}; expected one of {choices(frame, tree.frames)}")
    chain = [joint for joint in tree.route(frame) if joint.kind != "fixed"]
    for joint in chain:
        if joint.kind not in MOVING:
            raise InputError(
                f"{path}: joint '{joint.name}' is {joint.kind}; expected fixed, revolute, continuous or prismatic "
                "joints up to the measured link"
            )
    if not chain:
        raise InputError(
            f"{name or path}: no moving joint between the root and link {frame!r}; expected a link beyond a joint"
        )
    if len(chain) > LONGEST_CHAIN:
        raise InputError(f"{name or path}: {len(chain)} moving joints to {frame!r}, expected at most {LONGEST_CHAIN}")
    others = [joint for arm in arms for joint in tree.route(arm) if joint.kind != "fixed"]
    return _chain(tree, chain, others, _Called(name or tree.name or path.stem, frame, path))


def read_branches(path: Path, frames: list[str], *, name: str | None = None) -> Branches:
    """Read the arms of a URDF file that end at the links `frames`.
    Raises InputError as `read_urdf` does, or for a repeated link."""
    if len(set(frames)) < len(frames):
        raise InputError(f"{name or path}: frames {', '.join(frames)}; expected each link once")
    return Branches(name or path.stem, tuple(read_urdf(path, name=name, frame=frame, arms=frames) for frame in frames))


def default_frame(tree: UrdfTree) -> str:
    """Return the link that is measured by default: the last link of the arm with the most revolute joints.

    Fingers do not belong to the arm: the arm ends where a chain of at least ARM_DEPTH joints splits into equally long
    branches (fingers) of at most FINGER_DEPTH joints. If several last links are fixed to one part, `tool0` is
    preferred, then the first link in the file.
    """

    def most_turns(joint: UrdfJoint) -> int:
        beyond = tree.moving_below(joint.child)
        return int(joint.kind not in ("prismatic", "planar")) + max(map(most_turns, beyond), default=0)

    def depth(joint: UrdfJoint) -> int:
        return 1 + max(map(depth, tree.moving_below(joint.child)), default=0)

    part, passed = tree.root, 0
    while joints := list(tree.moving_below(part)):
        following = max(joints, key=most_turns)
        length = depth(following)
        alike = sum(depth(joint) == length for joint in joints) > 1
        if alike and passed >= ARM_DEPTH and length <= FINGER_DEPTH:
            break
        part, passed = following.child, passed + 1
    last = _last_fixed(tree, part)
    return next((text for text in last if text.endswith("tool0")), last[0])


def _last_fixed(tree: UrdfTree, part: str) -> list[str]:
    """Return the links at the ends of the longest sequences of fixed joints beyond the link `part`."""
    links = [part]
    while beyond := [j.child for link in links for j in tree.below[link] if j.kind == "fixed"]:
        links = beyond
    return links


@dataclass(frozen=True)
class _Called:
    """Names of a serial chain, of its measured link and of its file."""

    name: str
    frame: str
    path: Path


def _chain(tree: UrdfTree, chain: list[UrdfJoint], others: list[UrdfJoint], called: _Called) -> SerialChain:
    name, frame, path = called.name, called.frame, called.path
    names = [joint.name for joint in chain]
    driven = [joint for joint in chain if joint.mimic is None or joint.mimic.leader not in names]
    leaders = [joint.name for joint in driven]
    coupling = np.zeros((len(chain), len(driven)))
    links = []
    before = np.eye(4)
    for row, joint in enumerate(chain):
        if not np.any(joint.axis):
            raise InputError(f"{path}: joint {joint.name!r} has axis 0 0 0; expected a vector longer than zero")
        axis, sign, alignment = _aligned(joint)
        leader, factor, offset = joint.name, 1.0, 0.0
        if joint.mimic is not None and leader not in leaders:
            leader, factor, offset = joint.mimic.leader, joint.mimic.multiplier, joint.mimic.offset
        if leader not in leaders:
            raise InputError(
                f"{path}: joint {joint.name!r} mimics {leader!r}, which itself mimics another "
                "joint; expected a joint without <mimic>"
            )
        coupling[row, leaders.index(leader)] = sign * factor
        after = tree.frames[joint.child] @ alignment
        mass, com = _carried(tree, joint, [*chain, *others])
        links.append(
            Link(
                name=identifier(joint.name),
                placement=np.linalg.solve(before, after) @ along(axis, sign * offset),
                axis=axis,
                mass=mass,
                com=alignment[:3, :3].T @ com,
                alignment=alignment,
                offset=sign * offset,
            )
        )
        before = after
    words = [link.name for link in links]
    if twice := next((word for word in words if words.count(word) > 1), ""):
        raise InputError(
            f"{path}: two joints of the chain are named '{twice}' after other characters are replaced by underscores; "
            "expected different names"
        )
    return SerialChain(
        name=name,
        links=tuple(links),
        tool=np.asarray(np.linalg.solve(before, tree.frames[frame]), dtype=np.float64),
        joint_names=tuple(identifier(joint.name) for joint in driven),
        coupling=coupling,
        limits=np.array([_limits(joint, path) for joint in driven]),
        tool_frame=frame,
        source=path,
        not_read=tuple(text for joint in chain for text in joint.not_read),
    )


def _carried(tree: UrdfTree, joint: UrdfJoint, chains: list[UrdfJoint]) -> tuple[float, Array]:
    """Return mass [kg] and centre of mass (3,) [m] of all parts between a joint and the next joint of any chain.
    Centres of mass are in the frame of the joint's child link. Joints outside all chains are at rest."""
    mass, moment, waiting = 0.0, np.zeros(3), [joint.child]
    inverse = np.linalg.inv(tree.frames[joint.child])
    while waiting:
        link = waiting.pop()
        weighs, com = tree.masses[link]
        seen = inverse @ tree.frames[link]
        mass, moment = mass + weighs, moment + weighs * (seen[:3, :3] @ com + seen[:3, 3])
        waiting += [beyond.child for beyond in tree.below[link] if beyond not in chains]
    return mass, moment / mass if mass else moment


def _limits(joint: UrdfJoint, path: Path) -> tuple[float, float]:
    lower, upper = joint.limits
    if not lower <= upper:
        raise InputError(
            f"{path}: joint '{joint.name}': lower limit {lower:g} above upper limit {upper:g}; "
            "expected lower <= upper, in rad or m"
        )
    if joint.kind == "revolute" and max((abs(x) for x in (lower, upper) if np.isfinite(x)), default=0.0) > MOST_TURN:
        raise InputError(
            f"{path}: joint '{joint.name}': limits {lower:g} to {upper:g} rad look like degrees; expected rad, or type "
            "continuous for a joint without limits"
        )
    return lower, upper


def _aligned(joint: UrdfJoint) -> tuple[str, float, Array]:
    """Return the coordinate axis nearest to a joint's motion axis, its sign, and the rotation (4, 4) between both."""
    z, first = joint.axis, 0 if joint.kind == "prismatic" else 3
    largest = int(np.argmax(np.abs(z)))
    if np.isclose(abs(z[largest]), 1.0, rtol=0.0, atol=1e-12):
        return AXES[first + largest], float(np.sign(z[largest])), np.eye(4)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return AXES[first + 2], 1.0, se3.frame(np.column_stack([x, np.cross(z, x), z]), np.zeros(3))
