"""Load mechanisms by name or from a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.extras import extra_for
from gpmodel.numerics.se3 import shift
from robots.chain import Branches, SerialChain
from robots.dh import of_another_kind, read_dh
from robots.links import Link
from robots.urdf import read_branches, read_urdf

DIMENSIONS = {
    "irb6400r": {"d1": 0.800, "a1": 0.240, "a2": 1.050, "a3": 0.225, "d4": 1.175, "d6": 0.200},
    "irb6400r-2.8": {"d1": 0.800, "a1": 0.240, "a2": 1.050, "a3": 0.225, "d4": 1.520, "d6": 0.200},
}
LIMITS_DEG = ((-180, 180), (-70, 85), (-28, 110), (-300, 300), (-120, 120), (-300, 300))
AXES = ("Rz", "Ry", "Ry", "Rx", "Ry", "Rx")
SURROGATE_MASSES = (262.6, 156.2, 149.3, 10.2, 17.7, 41.5)


def irb6400r(name: str = "irb6400r") -> SerialChain:
    """Return the arm `irb6400r` (2.5-150) or `irb6400r-2.8` (2.8-200), measured at its flange.

    At zero joint values all frames are parallel to the root frame; the joint axes are Z Y Y X Y X. The value J3 is the
    angle of the upper arm to the ground, kept by the parallel bar: motion of link 3 = J3 - J2.
    The masses of an IRB 6400R are not public. The masses used are those of an arm of equal size (FANUC R-2000iC), and
    each centre of mass is midway between the origins of two successive joints (for the last, joint and flange).
    """
    size = DIMENSIONS[name]
    origins = np.array(
        [
            [0.0, 0.0, 0.0],
            [size["a1"], 0.0, size["d1"]],
            [0.0, 0.0, size["a2"]],
            [0.0, 0.0, size["a3"]],
            [size["d4"], 0.0, 0.0],
            [0.0, 0.0, 0.0],
            [size["d6"], 0.0, 0.0],
        ]
    )
    links = tuple(
        Link(f"J{i + 1}", shift(origins[i]), axis, mass, origins[i + 1] / 2)
        for i, (axis, mass) in enumerate(zip(AXES, SURROGATE_MASSES, strict=True))
    )
    coupling = np.eye(6)
    coupling[2, 1] = -1.0
    return SerialChain(
        name=name,
        links=links,
        tool=shift(origins[6]),
        joint_names=tuple(link.name for link in links),
        coupling=coupling,
        limits=np.radians(LIMITS_DEG),
        tool_frame="flange",
    )


# File in the robots folder of example-robot-data, and the link that is measured by default.
EXAMPLE_ARMS = {
    "baxter": ("baxter_description/urdf/baxter.urdf", "left_gripper"),
    "bravo7_no_ee": ("bravo7_description/urdf/bravo7_no_ee.urdf", "contact_point"),
    "kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    "panda": ("panda_description/urdf/panda.urdf", "panda_hand_tcp"),
    "so100": ("so_arm_description/urdf/so100.urdf", "gripper"),
    "so101": ("so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
    "talos_arm": ("talos_data/robots/talos_left_arm.urdf", "wrist_left_ft_tool_link"),
    "tiago_no_hand": ("tiago_description/robots/tiago_no_hand.urdf", "wrist_ft_tool_link"),
    "ur3": ("ur_description/urdf/ur3_robot.urdf", "tool0"),
    "ur3_limited": ("ur_description/urdf/ur3_joint_limited_robot.urdf", "tool0"),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "ur5_limited": ("ur_description/urdf/ur5_joint_limited_robot.urdf", "tool0"),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", "tool0"),
    "ur10_limited": ("ur_description/urdf/ur10_joint_limited_robot.urdf", "tool0"),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", "link_eef"),
    "z1": ("z1_description/urdf/z1.urdf", "gripperStator"),
}


def mechanism_names() -> tuple[str, ...]:
    """Return the names of the robots that load_mechanism accepts without a file."""
    return (*DIMENSIONS, *EXAMPLE_ARMS)


def load_mechanism(
    name: str, *, frame: str | None = None, payload_com: Sequence[float] | None = None
) -> SerialChain | Branches | None:
    """Load the robot `name`: one of mechanism_names(), or the path of a .urdf file or of a .toml file of DH rows
    (robots.dh).

    frame: measured link (default: the last link of the arm); for several arms of a URDF, one link per arm, separated by
    commas. For a TOML file with several arms, the default `frame` is that of every arm.
    payload_com: centre of mass (3,) of a payload in the measured frame, m (default: its origin). Return None if no
    robot has the name, or if a .toml file describes a mechanism of another kind. Raises InputError if the file is
    missing or invalid, or the frame unknown.
    """
    chain = _load(name, frame)
    if chain is None or payload_com is None:
        return chain
    if isinstance(chain, Branches):
        raise InputError(f"{chain.name}: a payload on several arms; expected one measured frame")
    return replace(chain, payload_com=_vector(payload_com))


def _load(name: str, frame: str | None) -> SerialChain | Branches | None:
    if name in DIMENSIONS:
        return _measured_at(irb6400r(name), frame)
    if name in EXAMPLE_ARMS:
        file, last_link = EXAMPLE_ARMS[name]
        with extra_for(f"'{name}'"):
            import example_robot_data

        folder = Path(example_robot_data.getModelPath(file))
        return _read_urdf(folder / file, name, last_link if frame is None else frame)
    suffix = Path(name).suffix.lower()
    if suffix == ".urdf":
        return _read_urdf(Path(name), None, frame)
    if suffix == ".toml" and not of_another_kind(Path(name)):
        return _measured_at(read_dh(Path(name)), frame)
    return None


def _read_urdf(path: Path, name: str | None, frame: str | None) -> SerialChain | Branches:
    frames = [part.strip() for part in (frame or "").split(",")]
    return read_urdf(path, name=name, frame=frame) if len(frames) == 1 else read_branches(path, frames, name=name)


def _measured_at(chain: SerialChain | Branches, frame: str | None) -> SerialChain | Branches:
    known = {c.tool_frame: c for c in (chain.chains if isinstance(chain, Branches) else (chain,))}
    if frame is None:
        return chain
    asked = [part.strip() for part in frame.split(",")]
    if unknown := [name for name in asked if name not in known]:
        has = choices(unknown[0], map(repr, known))
        raise InputError(f"{chain.name}: no measured frame named {unknown[0]!r}; expected one of {has}")
    chosen = tuple(known[name] for name in dict.fromkeys(asked))
    return chosen[0] if len(chosen) == 1 else Branches(chain.name, chosen)


def _vector(payload_com: Sequence[float]) -> Array:
    vector = np.asarray(payload_com, dtype=np.float64)
    if vector.shape != (3,) or not np.all(np.isfinite(vector)):
        raise InputError(f"payload centre of mass {tuple(payload_com)}: expected three lengths in the tool frame, m")
    return vector
