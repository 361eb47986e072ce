"""Write the refitted geometry for ROS: joint origins for xacro, robot_calibration's offsets, UR's kinematics file.

Sources: xacro.load_yaml; mikeferguson/robot_calibration, optimization/offsets.cpp, whose updateURDF applies offsets;
UniversalRobots/Universal_Robots_ROS2_Description, config/ur5e/default_kinematics.yaml and urdf/ur_macro.xacro.
"""

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.characters import commented
from gpmodel.errors import InputError
from gpmodel.numerics import se3
from gpmodel.table.of_programs import axis_of, origin_of

UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
"""Links of ur_description without the suffix `_link`, in the order of the joints that move them."""


@dataclass(frozen=True)
class JointOrigin:
    """Joint of a URDF. frame: pose (4, 4) of its origin on the parent link, m. axis: direction of motion."""

    name: str
    kind: str
    parent: str
    child: str
    axis: tuple[float, ...]
    frame: Array


def origins(text: str) -> dict[str, JointOrigin]:
    """Return the joints of a URDF text by name, in the order of the file."""
    return {o.name: o for o in map(_origin, ET.fromstring(text).findall("joint"))}


def kinematics_text(nominal: str, calibrated: str, note: str) -> str:
    """Write the calibrated origin of every joint of a nominal URDF as YAML: x, y, z, m, and roll, pitch, yaw, rad.

    A joint's six numbers are the values of `<origin xyz rpy>` in a xacro file. note: first comment of the file.
    """
    use = "kinematics:=${xacro.load_yaml('kinematics.yaml')['kinematics']}, ${kinematics['JOINT']['x']}"
    lines = [*commented(note), f"# In xacro: {use} and so on.", "kinematics:"]
    after = origins(calibrated)
    rows = (line for name in origins(nominal) for line in _row(json.dumps(name), after[name].frame))
    return "\n".join([*lines, *rows]) + "\n"


def offsets_text(nominal: str, calibrated: str, note: str) -> str:
    """Write robot_calibration's offsets of every joint whose origin changed: origin = nominal · offset.

    The offsets of a joint are NAME_x to NAME_z, m, and the rotation vector NAME_a to NAME_c, rad.
    """
    before, lines = origins(nominal), commented(note)
    for name, after in origins(calibrated).items():
        if name in before and not np.array_equal(before[name].frame, after.frame):
            offset: Array = np.linalg.inv(before[name].frame) @ after.frame
            values = [*offset[:3, 3], *se3.rotation_vector(offset[None, :3, :3])[0]]
            for axis, value in zip("xyzabc", values, strict=True):
                key = f"{name}_{axis}" if name.isidentifier() else json.dumps(f"{name}_{axis}")
                lines.append(f"{key}: {float(value)!r}")
    return "\n".join(lines) + "\n"


def ur_text(nominal: str, calibrated: str, note: str) -> str:
    """Write the kinematics file of ur_description: the frame of each of the six links on the preceding link.

    A change before the first joint is added to the origin of the first joint; ur_macro.xacro fixes the base.
    Raises InputError if the arm is not the chain of ur_description.
    """
    chain, before = _ur_chain(calibrated), origins(nominal)
    fixed = np.linalg.solve(_placed(before, chain[0].parent), _placed(origins(calibrated), chain[0].parent))
    frames = [fixed @ chain[0].frame, *(o.frame for o in chain[1:])]
    hashed = "hash: gpmodel  # the driver expects that of the controller here, and says so when it connects"
    lines = [*commented(note), "kinematics:"]
    rows = (line for name, frame in zip(UR_LINKS, frames, strict=True) for line in _row(name, frame))
    return "\n".join([*lines, *rows, f"  {hashed}"]) + "\n"


def beyond(text: str, link: str, measured: str) -> Array:
    """Return the pose of the measured link in the frame of an earlier link, m; all joints between must be fixed."""
    known = origins(text)
    return np.asarray(np.linalg.inv(_placed(known, link)) @ _placed(known, measured))


def last_ur_link(text: str) -> str:
    """Return the last link of the kinematics file of ur_description. Raises InputError without the six links of a UR
    arm."""
    return _ur_chain(text)[-1].child


def _ur_chain(text: str) -> tuple[JointOrigin, ...]:
    moving = [o for o in origins(text).values() if o.kind != "fixed"]
    found = tuple(next((o for o in moving if o.child.endswith(f"{name}_link")), None) for name in UR_LINKS)
    chain = tuple(o for o in found if o is not None)
    if len(chain) < len(UR_LINKS):
        raise InputError(f"no arm of ur_description; expected links {', '.join(f'{name}_link' for name in UR_LINKS)}")
    for o, last in zip(chain, (None, *chain), strict=False):
        if o.axis != (0.0, 0.0, 1.0) or (last and o.parent != last.child):
            raise InputError(
                f"'{o.name}' is not as in ur_description; expected a rotation about z of the previous link"
            )
    return chain


def _origin(joint: ET.Element) -> JointOrigin:
    parent, child = ("" if (link := joint.find(tag)) is None else link.get("link", "") for tag in ("parent", "child"))
    axis, frame = tuple(axis_of(joint, "calibrated.urdf")), origin_of(joint, "calibrated.urdf")
    return JointOrigin(joint.get("name", ""), joint.get("type", ""), parent, child, axis, frame)


def _placed(known: Mapping[str, JointOrigin], link: str) -> Array:
    """Return the pose of a link in the root frame, m, with every joint at zero."""
    above, frame = {o.child: o for o in known.values()}, np.eye(4)
    while link in above:
        frame, link = above[link].frame @ frame, above[link].parent
    return frame


def _row(name: str, frame: Array) -> Iterator[str]:
    yield f"  {name}:"
    numbers = [*frame[:3, 3], *se3.roll_pitch_yaw(frame[:3, :3])]
    for word, value in zip(("x", "y", "z", "roll", "pitch", "yaw"), numbers, strict=True):
        yield f"    {word}: {float(value)!r}"
