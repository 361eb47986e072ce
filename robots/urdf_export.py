"""Export of calibrated geometry as URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.characters import harmless
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.numerics import se3
from gpmodel.table.units import identifier
from robots.links import Chain, along
from robots.urdf_tree import origin_of, parse_xml


def write_calibrated_urdf(mechanism: Chain, twists: Mapping[str, Array], path: Path) -> str:
    """Write a mechanism with a constant error twist at each frame (slot) as URDF; return the link to measure at.

    root -> measured link  =  T_0 E_0 T_1(q) E_1 ... T_S(q) E_S,   E_s = exp(twists[s])

    T_s: nominal transform to slot s. twists: {slot: (Tx, Ty, Tz, Rx, Ry, Rz) in the frame of the slot, m and rad}. A
    mechanism from a URDF gives the original file with changed joint origins; parts attached to a link move with the
    link. A mechanism from another source gives a new file in the joint coordinates of the table. A link moved by a
    second coordinate, as by a parallel bar, gets a mimic joint NAME_with_OTHER about its axis for each such coordinate.
    If the measured link is the last link of the chain, a twist beyond the last joint needs an additional link
    FRAME_calibrated. Raises InputError for an unknown slot, or a file that cannot be written.
    """
    errors = _errors(mechanism, twists)
    if mechanism.source is None:
        robot, frame = _generated(mechanism, errors), mechanism.tool_frame
    else:
        robot = parse_xml(mechanism.source)
        frame = _corrected(mechanism, robot, errors)
    _write(robot, path)
    return frame


def write_arms_urdf(arms: Sequence[tuple[Chain, Mapping[str, Array]]], path: Path) -> str:
    """Write several arms of one tree, each with its error twists by frame; return the measured links, with commas.

    If the tree comes from a file, the twist of a shared frame (slot) is written with the first arm that has the slot.
    """
    robot, frames = None, []
    for mechanism, twists in arms:
        errors = _errors(mechanism, twists)
        if mechanism.source is not None:
            robot = parse_xml(mechanism.source) if robot is None else robot
            frames.append(_corrected(mechanism, robot, errors))
            continue
        own = _generated(mechanism, errors)
        robot = own if robot is None else robot
        there = {(part.tag, part.get("name")) for part in robot}
        robot.extend(part for part in own if (part.tag, part.get("name")) not in there)
        frames.append(mechanism.tool_frame)
    assert robot is not None
    _write(robot, path)
    return ",".join(frames)


def _errors(mechanism: Chain, twists: Mapping[str, Array]) -> dict[str, Array]:
    """Return {frame (slot): transform (4, 4) of its error twist}. Raises InputError for an unknown slot."""
    for slot, twist in twists.items():
        if slot not in mechanism.slots or np.shape(twist) != (6,) or not np.all(np.isfinite(twist)):
            raise InputError(
                f"twist at {slot!r} of {mechanism.name}: expected six finite numbers at one of "
                f"{', '.join(mechanism.slots)}"
            )
    errors = dict.fromkeys(mechanism.slots, np.eye(4))
    return errors | {slot: se3.exp(np.asarray(twist, dtype=np.float64)) for slot, twist in twists.items()}


def _write(robot: ET.Element, path: Path) -> None:
    ET.indent(robot)
    try:
        ET.ElementTree(robot).write(path, encoding="utf-8", xml_declaration=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error


def _corrected(mechanism: Chain, robot: ET.Element, errors: Mapping[str, Array]) -> str:
    joints = {identifier(joint.get("name", "")): joint for joint in robot.findall("joint")}
    above = {_link(joint, "child"): joint for joint in joints.values()}
    route = [above[mechanism.tool_frame]]
    while _link(route[0], "parent") in above:
        route.insert(0, above[_link(route[0], "parent")])
    _compose(route[0], before=errors["base"])
    for link in mechanism.links:
        joint = joints[link.name]
        turn = link.alignment @ along(link.axis, link.offset)
        _compose(joint, after=_seen_from(turn, errors[f"{link.name}.fixed"]))
        moved = _seen_from(link.alignment, errors[f"{link.name}.moving"])
        for beyond in joints.values():
            if _link(beyond, "parent") == _link(joint, "child"):
                _compose(beyond, before=moved)
    if identifier(route[-1].get("name", "")) != mechanism.links[-1].name:
        _compose(route[-1], after=errors["tool"])
        return mechanism.tool_frame
    if np.array_equal(moved, np.eye(4)) and np.array_equal(errors["tool"], np.eye(4)):
        return mechanism.tool_frame
    frame = f"{mechanism.tool_frame}_calibrated"
    offset = moved @ link.alignment @ mechanism.tool @ errors["tool"]
    ET.SubElement(robot, "link", name=frame)
    _add_joint(robot, f"{frame}_joint", "fixed", mechanism.tool_frame, frame, offset)
    return frame


def _generated(mechanism: Chain, errors: Mapping[str, Array]) -> ET.Element:
    robot = ET.Element("robot", name=harmless(mechanism.name))
    parent, before = "base_link", errors["base"]
    ET.SubElement(robot, "link", name=parent)
    for row, link in enumerate(mechanism.links):
        origin = before @ link.placement @ errors[f"{link.name}.fixed"]
        body = _add_motions(robot, mechanism, row, parent, origin)
        if link.mass:
            inertial = ET.SubElement(body, "inertial")
            ET.SubElement(inertial, "origin", xyz=_text(link.com), rpy="0 0 0")
            ET.SubElement(inertial, "mass", value=repr(float(link.mass)))
            ET.SubElement(inertial, "inertia", dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0"))
        parent, before = body.get("name", ""), errors[f"{link.name}.moving"]
    ET.SubElement(robot, "link", name=mechanism.tool_frame)
    tool = before @ mechanism.tool @ errors["tool"]
    _add_joint(robot, f"{mechanism.tool_frame}_joint", "fixed", parent, mechanism.tool_frame, tool)
    return robot


def _add_motions(robot: ET.Element, mechanism: Chain, row: int, parent: str, origin: Array) -> ET.Element:
    """Add the joint of a link, then a mimic joint about its axis for every further coordinate that moves the link.
    Return the last <link> element. Raises InputError if the factor of the link's own coordinate is not 1 or -1."""
    link, names, weights = mechanism.links[row], mechanism.joint_names, mechanism.coupling[row]
    own = names.index(link.name)
    if abs(weights[own]) != 1.0:
        raise InputError(
            f"{mechanism.name}: {link.name} moves by {weights[own]:g} times the joint value; expected factor 1 or -1"
        )
    others = [column for column in np.flatnonzero(weights).tolist() if column != own]
    ends = [*(f"{link.name}_before_{names[column]}_link" for column in others), f"{link.name}_link"]
    axis = np.zeros(3)
    axis[AXES.index(link.axis) % 3] = weights[own]
    for column, child in zip([own, *others], ends, strict=True):
        factor = float(weights[own] * weights[column])
        lower, upper = np.sort(factor * mechanism.limits[column])
        bounded = bool(np.all(np.isfinite((lower, upper))))
        kind = "prismatic" if link.axis.startswith("T") else "revolute" if bounded else "continuous"
        body = ET.SubElement(robot, "link", name=child)
        name = link.name if column == own else f"{link.name}_with_{names[column]}"
        joint = _add_joint(robot, name, kind, parent, child, origin)
        ET.SubElement(joint, "axis", xyz=_text(axis))
        if kind != "continuous":
            limits = {"lower": repr(float(lower)), "upper": repr(float(upper))} if bounded else {}
            ET.SubElement(joint, "limit", limits, effort="0", velocity="0")
        if column != own:
            ET.SubElement(joint, "mimic", joint=names[column], multiplier=repr(factor), offset="0")
        parent, origin = child, np.eye(4)
    return body


def _add_joint(robot: ET.Element, name: str, kind: str, parent: str, child: str, origin: Array) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    _set_origin(joint, origin)
    return joint


def _seen_from(frame: Array, error: Array) -> Array:
    """Convert an error transform in `frame` to the parent of `frame`; the identity stays exact."""
    return error if np.array_equal(error, np.eye(4)) else frame @ error @ np.linalg.inv(frame)


def _compose(joint: ET.Element, *, before: Array | None = None, after: Array | None = None) -> None:
    transform = origin_of(joint)
    changed = transform if before is None else before @ transform
    changed = changed if after is None else changed @ after
    if not np.array_equal(changed, transform):
        _set_origin(joint, changed)


def _set_origin(joint: ET.Element, transform: Array) -> None:
    origin = joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    origin.set("xyz", _text(transform[:3, 3]))
    origin.set("rpy", _text(se3.roll_pitch_yaw(transform[:3, :3])))


def _text(numbers: Array) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def _link(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else element.get("link", "")
