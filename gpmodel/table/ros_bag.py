"""Import of ROS 1 and 2 recordings (bags): joint states, and measured points, poses or transforms.

Sources: sensor_msgs/JointState; geometry_msgs/PointStamped, PoseStamped, TransformStamped; read by rosbags.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.extras import extra_for
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.foreign import Imported, cells, joint_cells, surplus_joints

JOINTS = "sensor_msgs/msg/JointState"
MEASURED = {
    "geometry_msgs/msg/PointStamped": ("point", "", ""),
    "geometry_msgs/msg/PoseStamped": ("pose", "position", "orientation"),
    "geometry_msgs/msg/TransformStamped": ("transform", "translation", "rotation"),
}
"""Types of ROS messages, and the fields with the point and the quaternion."""
APART = 0.05
"""Largest time between a measurement and its joint state, s. Drives report joint states at least 20 times a second."""


@dataclass(frozen=True)
class _JointState:
    """A joint state in a ROS recording. time: s. values: joint name -> value, rad or m."""

    time: float
    values: dict[str, float]


@dataclass(frozen=True)
class _Measured:
    """A measurement in a ROS recording. time: s. point: m. vector: rotation vector, rad, NaN if not measured."""

    time: float
    point: Array
    vector: Array


def is_bag(path: Path) -> bool:
    """Return whether a path is a ROS recording: a ROS 1 file, or a file or folder of ROS 2."""
    return path.suffix.lower() in (".bag", ".mcap", ".db3") or (path / "metadata.yaml").is_file()


def bag_table(path: Path, mechanism: Mechanism | None, topic: str | None) -> Imported:
    """Return a table with one row per measurement and the joint state nearest in time.

    topic: topic of the measurements, required if the recording has several.
    Raises InputError if rosbags or the file is missing, a topic is missing or ambiguous, or no joint state is near.
    """
    states, measured = _messages(path, topic)
    if not states or not measured:
        raise InputError(f"{path.name}: {len(states)} joint states, {len(measured)} measurements; expected both")
    times, asked = (np.array([message.time for message in part]) for part in (states, measured))
    nearest = np.argmin(np.abs(times[:, None] - asked[None]), axis=0)
    if (late := np.abs(times[nearest] - asked)).max() > APART:
        k = int(np.argmax(late))
        raise InputError(
            f"{path.name}: measurement {k + 1} is {late[k]:.2f} s from any joint state; expected {APART:g} s at most"
        )
    names = sorted({name for state in states for name in state.values})
    values = {name: np.array([states[i].values.get(name, np.nan) for i in nearest]) for name in names}
    out = joint_cells(mechanism, values, path.name)
    points, vectors = np.array([m.point for m in measured]), np.array([m.vector for m in measured])
    out |= {f"{axis} [m]": cells(v) for axis, v in zip("xyz", points.T, strict=True)}
    if np.isfinite(vectors).any():
        out |= {f"r{axis} [rad]": cells(v) for axis, v in zip("xyz", vectors.T, strict=True)}
    return Imported(pd.DataFrame(out), left_out=surplus_joints(mechanism, values))


def _messages(path: Path, topic: str | None) -> tuple[list[_JointState], list[_Measured]]:
    """Read the joint states and the measurements of a ROS recording."""
    with extra_for(f"reading {path.name}"):
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    states, measured = [], []
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            known = [(c.topic, c.msgtype) for c in reader.connections]
            joints = _only((name for name, kind in known if kind == JOINTS), path, JOINTS)
            seen = (name for name, kind in known if kind in MEASURED and topic in (None, name))
            read = _only(seen, path, " or ".join(name.rpartition("/")[2] for name in MEASURED))
            for connection, _, raw in reader.messages([c for c in reader.connections if c.topic in (joints, read)]):
                message: object = reader.deserialize(raw, connection.msgtype)
                if connection.topic == joints:
                    states.append(_state(message))
                else:
                    measured.append(_measurement(message, connection.msgtype))
    except AnyReaderError as error:
        raise InputError(f"{path}: cannot be read as a ROS bag ({error})") from None
    return states, measured


def _only(names: Iterable[str], path: Path, kind: str) -> str:
    topics = sorted(set(names))
    if len(topics) != 1:
        said = ", ".join(topics) or "none"
        raise InputError(f"{path.name}: topics of {kind}: {said}; expected one, or --topic of the measurements")
    return topics[0]


def _state(message: object) -> _JointState:
    names: Sequence[str] = _part(message, "name")
    return _JointState(_time(message), dict(zip(names, map(float, _part(message, "position")), strict=False)))


def _measurement(message: object, kind: str) -> _Measured:
    part, point, turn = MEASURED[kind]
    whole = _part(message, part)
    at, vector = _part(whole, point) if point else whole, np.full(3, np.nan)
    if turn:
        vector = Rotation.from_quat([float(_part(_part(whole, turn), axis)) for axis in "xyzw"]).as_rotvec()
    return _Measured(_time(message), np.array([float(_part(at, axis)) for axis in "xyz"]), vector)


def _time(message: object) -> float:
    stamp = _part(_part(message, "header"), "stamp")
    return float(_part(stamp, "sec")) + 1e-9 * float(_part(stamp, "nanosec"))


_part = getattr
"""Function that reads a field of a ROS message; the package rosbags creates the class of the message."""
