"""Calibrated geometry written as URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.numerics import se3
from gpmodel.table.units import identifier
from gpmodel.texts import harmless
from robots.links import Chain, along
from robots.urdf_file import parse_xml
from robots.urdf_tree import origin_of


def write_calibrated_urdf(mechanism: Chain, twists: Mapping[str, Array], path: Path) -> str:
    """Writes the mechanism with a constant error twist at each slot as URDF; returns the link to measure at.

        root -> measured link  =  T_0 E_0 T_1(q) E_1 ... T_S(q) E_S,   E_s = exp(twists[s])

    twists: by slot, (6,) as (Tx, Ty, Tz, Rx, Ry, Rz) in the frame of the slot, m and rad; no entry, no error.
    A mechanism read from URDF gives that file with the origins of its joints changed; all that hangs on a link
    moves with it. Any other gives a new file in the motions of its own joints: URDF has no parallel bar, so a
    comment states how a motion follows the coordinates of the measured table. A twist beyond the last joint of
    a chain measured at its very last link needs a link of its own, FRAME_calibrated.
    Raises InputError for a slot the mechanism does not have, or a file that cannot be written.
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
    """The same of several arms of one tree, each with the twists by its own slots; where they are read from a file,
    those of shared slots with the first arm that has them. Returns the links to measure at, commas between them."""
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
    """Slot -> the motion (4, 4) of its twist. Raises InputError for a slot that the mechanism does not have."""
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
        child = f"{link.name}_link"
        body = ET.SubElement(robot, "link", name=child)
        if link.mass:
            inertial = ET.SubElement(body, "inertial")
            ET.SubElement(inertial, "origin", xyz=_text(link.com), rpy="0 0 0")
            ET.SubElement(inertial, "mass", value=repr(float(link.mass)))
            ET.SubElement(inertial, "inertia", dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0"))
        column = mechanism.joint_names.index(link.name)
        sign = float(np.sign(mechanism.coupling[row, column]))
        weights = sign * mechanism.coupling[row]
        alone = np.count_nonzero(weights) == 1
        lower, upper = mechanism.limits[column] if alone else (-np.inf, np.inf)
        bounded = bool(np.all(np.isfinite((lower, upper))))
        kind = "prismatic" if link.axis.startswith("T") else "revolute" if bounded else "continuous"
        if not alone:
            terms = (f"{w:+g} * {name}" for w, name in zip(weights, mechanism.joint_names, strict=True) if w)
            robot.append(ET.Comment(f" {link.name} here, from the measured table: {' '.join(terms)} "))
        origin = before @ link.placement @ errors[f"{link.name}.fixed"]
        joint = _add_joint(robot, link.name, kind, parent, child, origin)
        axis = np.zeros(3)
        axis[AXES.index(link.axis) % 3] = sign
        ET.SubElement(joint, "axis", xyz=_text(axis))
        if kind != "continuous":
            limits = {"lower": repr(float(lower)), "upper": repr(float(upper))} if bounded else {}
            ET.SubElement(joint, "limit", limits, effort="0", velocity="0")
        parent, before = child, errors[f"{link.name}.moving"]
    ET.SubElement(robot, "link", name=mechanism.tool_frame)
    tool = before @ mechanism.tool @ errors["tool"]
    _add_joint(robot, f"{mechanism.tool_frame}_joint", "fixed", parent, mechanism.tool_frame, tool)
    return robot


def _add_joint(robot: ET.Element, name: str, kind: str, parent: str, child: str, origin: Array) -> ET.Element:
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    _set_origin(joint, origin)
    return joint


def _seen_from(frame: Array, error: Array) -> Array:
    """An error that acts in the frame, as it acts in the frame's own reference; none stays exactly none."""
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
