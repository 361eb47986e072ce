"""Serial chains read from URDF files; meshes are never opened."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.mechanism.quantities import checked_mass
from gpmodel.table.units import identifier
from robots.chain import SerialChain
from robots.links import Link
from robots.motion import along
from robots.urdf_file import Mimic, parse_mimics, parse_model

FINGER_DEPTH = 3
ARM_DEPTH = 3
LONGEST_CHAIN = 64
"""Moving joints; work and memory grow with their square. A snake robot has 20."""


def read_urdf(path: Path, *, name: str | None = None, frame: str | None = None) -> SerialChain:
    """The chain of a URDF file from its root link to `frame`, a link (default: `default_frame`).

    Revolute, continuous and prismatic joints on the chain are its joints, except mimic joints, which follow
    theirs; floating and planar ones, and all joints off the chain, stay at neutral, and what hangs there
    weighs on the chain. A joint whose axis is no coordinate axis has the frames of its slots turned so that
    it is z.

    Raises InputError where the file cannot be read as URDF, or `frame` is no link beyond a moving joint.
    """
    mimics = parse_mimics(path)
    model = parse_model(path)
    for body, inertia in zip(model.names, model.inertias, strict=True):
        checked_mass(inertia.mass, f"{path}: what joint '{body}' moves weighs")
    frame = default_frame(model) if frame is None else frame
    if not model.existBodyName(frame):
        links = [f.name for f in model.frames if f.type == pin.FrameType.BODY]
        raise InputError(f"{name or path}: no link named {frame!r} to measure at; its links are {', '.join(links)}")
    chain = _moving_joints(model, frame)
    if not chain:
        raise InputError(f"{name or path}: no moving joint between the root and link {frame!r}; choose another frame")
    if len(chain) > LONGEST_CHAIN:
        raise InputError(f"{name or path}: {len(chain)} moving joints to {frame!r}, expected at most {LONGEST_CHAIN}")
    return _chain(model, chain, name or path.stem, frame, mimics, path)


def default_frame(model: pin.Model) -> str:
    """The link measured at when none is named: the last one of the arm with the most revolute joints.

    Fingers are not the arm: where a chain of at least ARM_DEPTH joints splits into equally long branches of
    at most FINGER_DEPTH joints, it ends. Of several last links fixed to the same part, `tool0` goes before the first in
    the file.
    """

    def turns(joint: int) -> int:
        return int("Prismatic" not in (text := model.joints[joint].shortname()) and not text.startswith("JointModelP"))

    def most_turns(joint: int) -> int:
        return turns(joint) + max((most_turns(int(child)) for child in model.children[joint]), default=0)

    def depth(joint: int) -> int:
        return 1 + max((depth(int(child)) for child in model.children[joint]), default=0)

    joint, passed = 0, 0
    while children := [int(child) for child in model.children[joint]]:
        following = max(children, key=most_turns)
        length = depth(following)
        alike = sum(depth(child) == length for child in children) > 1
        if alike and passed >= ARM_DEPTH and length <= FINGER_DEPTH:
            break
        joint, passed = following, passed + 1
    links = [i for i, f in enumerate(model.frames) if f.parentJoint == joint and f.type == pin.FrameType.BODY]

    def fixed_depth(link: int) -> int:
        parent = model.frames[link].parentFrame
        return 0 if model.frames[parent].parentJoint != joint or parent == link else 1 + fixed_depth(parent)

    last = max(map(fixed_depth, links))
    names = [model.frames[i].name for i in links if fixed_depth(i) == last]
    return next((text for text in names if text.endswith("tool0")), names[0])


def _moving_joints(model: pin.Model, frame: str) -> list[int]:
    tip = model.frames[model.getFrameId(frame, pin.FrameType.BODY)].parentJoint
    return [int(i) for i in model.supports[tip] if i and model.joints[i].nv == 1]


def _chain(
    model: pin.Model,
    chain: list[int],
    name: str,
    frame: str,
    mimics: dict[str, Mimic],
    path: Path,
) -> SerialChain:
    data, neutral = model.createData(), pin.neutral(model)
    pin.computeJointJacobians(model, data, neutral)
    pin.updateFramePlacements(model, data)
    names = [model.names[i] for i in chain]
    driven = [joint for joint in names if joint not in mimics or mimics[joint].leader not in names]
    inertias = _carried(model, data, chain)
    coupling = np.zeros((len(chain), len(driven)))
    links = []
    before = np.eye(4)
    for row, index in enumerate(chain):
        joint = model.joints[index]
        jacobian = pin.getJointJacobian(model, data, index, pin.LOCAL).reshape(6, model.nv)
        screw = jacobian[:, joint.idx_v]
        if not np.any(screw):
            raise InputError(f"{path}: joint {names[row]!r} has axis 0 0 0; expected a direction")
        axis, sign, alignment = _aligned(screw)
        leader, factor, offset = names[row], 1.0, 0.0
        if leader not in driven:
            mimic = mimics[leader]
            leader, factor, offset = mimic.leader, mimic.multiplier, mimic.offset
        if leader not in driven:
            raise InputError(f"{path}: joint {names[row]!r} mimics {leader!r}, which itself mimics another joint")
        coupling[row, driven.index(leader)] = sign * factor
        after = data.oMi[index].homogeneous @ alignment
        links.append(
            Link(
                name=identifier(names[row]),
                placement=np.linalg.solve(before, after) @ along(axis, sign * offset),
                axis=axis,
                mass=inertias[row].mass,
                com=alignment[:3, :3].T @ inertias[row].lever,
                alignment=alignment,
                offset=sign * offset,
            )
        )
        before = after
    measured = data.oMf[model.getFrameId(frame, pin.FrameType.BODY)].homogeneous
    return SerialChain(
        name=name,
        links=tuple(links),
        tool=np.linalg.solve(before, measured),
        joint_names=tuple(identifier(joint) for joint in driven),
        coupling=coupling,
        limits=np.array([_limits(model, chain[names.index(joint)], path) for joint in driven]),
        tool_frame=frame,
        source=path,
    )


def _carried(model: pin.Model, data: pin.Data, chain: list[int]) -> list[pin.Inertia]:
    """Inertia each joint of the chain carries, what hangs on it through joints off the chain included."""
    carried = [pin.Inertia.Zero() for _ in chain]
    for body in range(1, model.njoints):
        on_chain = [int(i) for i in model.supports[body] if int(i) in chain]
        if on_chain and model.inertias[body].mass:
            holder = data.oMi[on_chain[-1]]
            carried[chain.index(on_chain[-1])] += (holder.inverse() * data.oMi[body]).act(model.inertias[body])
    return carried


def _limits(model: pin.Model, index: int, path: Path) -> tuple[float, float]:
    joint = model.joints[index]
    if joint.nq > 1:
        return -np.inf, np.inf
    lower, upper = float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])
    if not lower <= upper:
        raise InputError(
            f"{path}: joint '{model.names[index]}': lower limit {lower:g} above upper limit {upper:g}; "
            "expected lower <= upper, in rad or m"
        )
    return lower, upper


def _aligned(screw: Array) -> tuple[str, float, Array]:
    """Axis name, sign, and the rotation (4, 4) of the joint frame that puts the motion on that axis."""
    largest = int(np.argmax(np.abs(screw)))
    if np.isclose(abs(screw[largest]), 1.0, rtol=0.0, atol=1e-12):
        return AXES[largest], float(np.sign(screw[largest])), np.eye(4)
    first = 0 if largest < 3 else 3
    z = screw[first : first + 3] / np.linalg.norm(screw[first : first + 3])
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    turn = np.eye(4)
    turn[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return AXES[first + 2], 1.0, turn
