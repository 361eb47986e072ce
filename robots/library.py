"""Mechanisms by name or by file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import example_robot_data
import numpy as np

from gpmodel.errors import InputError
from gpmodel.mechanism import Array
from robots.chain import SerialChain
from robots.irb6400r import DIMENSIONS, irb6400r
from robots.urdf import read_urdf

EXAMPLE_ARMS = {
    "kinova": "kinova_description/robots/kinova.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "so100": "so_arm_description/urdf/so100.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
    "talos_arm": "talos_data/robots/talos_left_arm.urdf",
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
}


def mechanism_names() -> tuple[str, ...]:
    """Names that load_mechanism knows without a file."""
    return (*DIMENSIONS, *EXAMPLE_ARMS)


def load_mechanism(
    name: str, *, frame: str | None = None, payload_com: Sequence[float] | None = None
) -> SerialChain | None:
    """The robot `name`: one of mechanism_names(), or a path to a .urdf file.

    frame: link to measure at (default: the last link of the arm). payload_com: (3,) m, centre of mass of a
    payload in the measured frame (default: its origin). None where the name is none of a robot.
    Raises InputError where the file is missing or bad, or the frame unknown.
    """
    chain = _load(name, frame)
    if chain is None or payload_com is None:
        return chain
    return replace(chain, payload_com=_vector(payload_com))


def _load(name: str, frame: str | None) -> SerialChain | None:
    if name in DIMENSIONS:
        return _measured_at(irb6400r(name), frame)
    if name in EXAMPLE_ARMS:
        folder = Path(example_robot_data.getModelPath(EXAMPLE_ARMS[name]))
        return read_urdf(folder / EXAMPLE_ARMS[name], name=name, frame=frame)
    suffix = Path(name).suffix.lower()
    if suffix == ".urdf":
        return read_urdf(Path(name), frame=frame)
    return None


def _measured_at(chain: SerialChain, frame: str | None) -> SerialChain:
    if frame not in (None, chain.tool_frame):
        raise InputError(f"{chain.name}: no frame named {frame!r} to measure at; it has {chain.tool_frame!r}")
    return chain


def _vector(payload_com: Sequence[float]) -> Array:
    vector = np.asarray(payload_com, dtype=np.float64)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise InputError(
            f"payload centre of mass {tuple(payload_com)}: expected three lengths in the tool frame, m"
        )
    return vector
