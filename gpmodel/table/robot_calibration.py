"""Result of robot_calibration: offsets of joints and frames, inserted into their URDF.

    origin' = origin · X · M(o),   X of NAME_x, NAME_y, NAME_z, m, and NAME_a, NAME_b, NAME_c, a rotation vector, rad;
    M(o) the motion of the joint NAME by its offset o, rad or m

Source: mikeferguson/robot_calibration, optimization/offsets.cpp, getOffsetYAML and updateURDF, where an offset of a
joint goes into <calibration rising>, which nothing reads.
"""

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.quantities import LARGEST
from gpmodel.numerics import se3
from gpmodel.table.imported import Imported, left_out
from gpmodel.texts import read_text

LARGEST_FILE = 16 << 20
"""Bytes of a URDF."""
EXPECTED = "robot_calibration's offsets, a line `NAME: number` each, of at most 1000 m or rad"


def calibrated_urdf(path: Path, nominal: Path) -> Imported:
    """The URDF with the offsets in it. Raises InputError where a file cannot be read, or no offset is of one of its
    joints."""
    offsets = _offsets(path)
    try:
        robot = ET.fromstring(read_text(nominal, LARGEST_FILE, "a URDF file"))
    except ET.ParseError as error:
        raise InputError(f"{nominal.name}: is no XML ({error}); expected the URDF that was calibrated") from None
    if robot.tag != "robot":
        raise InputError(f"{nominal.name}: the root element is <{robot.tag}>, expected <robot> as in a URDF file")
    used: set[str] = set()
    for joint in robot.findall("joint"):
        name = joint.get("name", "")
        keys = [f"{name}_{axis}" for axis in "xyzabc"]
        turn = Rotation.from_rotvec([offsets.get(key, 0.0) for key in keys[3:]]).as_matrix()
        frame = se3.frame(turn, [offsets.get(key, 0.0) for key in keys[:3]])
        if found := {name, *keys} & offsets.keys():
            _set_origin(
                joint, origin_of(joint, nominal.name) @ frame @ _motion(joint, offsets.get(name, 0.0), nominal.name)
            )
            used |= found
    if not used:
        raise InputError(f"{path.name}: no offset of a joint of {nominal.name}; it has {choices('', offsets)}")
    left = left_out(f"no joint of {nominal.name}", sorted(offsets.keys() - used))
    note = "; ".join([f"{nominal.name} with the offsets of {path.name}", *(f"left out, {text}" for text in left)])
    robot.insert(0, ET.Comment(f" {note.replace('--', '- -')} "))
    return Imported(ET.tostring(robot, encoding="unicode") + "\n", left_out=left)


def _offsets(path: Path) -> dict[str, float]:
    out: dict[str, float] = {}
    for number, line in enumerate(read_text(path, LARGEST_FILE, EXPECTED).splitlines(), 1):
        if not (text := line.partition("#")[0].strip()) or text == "---":
            continue
        name, found, value = text.rpartition(":")
        try:
            out[name.strip()] = float(value) if found else math.nan
        except ValueError:
            out[name.strip()] = math.nan
        if not abs(out[name.strip()]) <= LARGEST["length"]:
            raise InputError(f"{path.name}, line {number}: {text[:60]!r}; expected {EXPECTED}")
    return out


def _given(joint: ET.Element, tag: str, key: str, default: str, file: str) -> list[float]:
    """Three numbers of a joint's tag."""
    place = joint.find(tag)
    text = default if place is None else place.get(key, default)
    try:
        out = [float(word) for word in text.split()]
    except ValueError:
        out = []
    if len(out) != 3:
        raise InputError(f"{file}, joint '{joint.get('name')}', {tag}: '{text}'; expected three numbers")
    return out


def origin_of(joint: ET.Element, file: str) -> Array:
    """Where a joint of a URDF sits on its parent link, (4, 4), m. Raises InputError naming the file."""
    turn = Rotation.from_euler("xyz", _given(joint, "origin", "rpy", "0 0 0", file)).as_matrix()
    return se3.frame(turn, _given(joint, "origin", "xyz", "0 0 0", file))


def axis_of(joint: ET.Element, file: str) -> list[float]:
    """The three numbers of a joint's axis. Raises InputError likewise."""
    return _given(joint, "axis", "xyz", "1 0 0", file)


def _motion(joint: ET.Element, value: float, file: str) -> Array:
    along = np.array(axis_of(joint, file))
    along = along / (np.linalg.norm(along) or 1.0)
    slides = joint.get("type") == "prismatic"
    return np.asarray(se3.exp(value * np.concatenate([along * slides, along * (not slides)])))


def _set_origin(joint: ET.Element, frame: Array) -> None:
    place = joint.find("origin")
    place = ET.SubElement(joint, "origin") if place is None else place
    for key, numbers in (("xyz", frame[:3, 3]), ("rpy", se3.roll_pitch_yaw(frame[:3, :3]))):
        place.set(key, " ".join(repr(float(v)) for v in numbers))
