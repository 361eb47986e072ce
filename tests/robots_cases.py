"""Robots for the tests, and forward kinematics computed from the transforms of a mechanism alone."""

from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import Mechanism
from robots import load_mechanism
from robots.chain import SerialChain

# Every kind of joint the reader must place: oblique, continuous, prismatic against its axis, mimic with an offset,
# floating, off the chain, and against its axis; a link of a joint's name.
ODD_URDF = """<?xml version="1.0"?>
<robot name="odd">
  <link name="world"/>
  <link name="bench"><inertial><origin xyz="0 0 0.1"/><mass value="50"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="swing"><inertial><origin xyz="0.1 0.02 -0.03"/><mass value="7"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="carriage"><inertial><origin xyz="0 0 0.2"/><mass value="3"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="follower"><inertial><origin xyz="-0.1 0 0.1"/><mass value="2"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="loose"/>
  <link name="wrist"><inertial><origin xyz="0 0.05 0"/><mass value="1"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="flap"><inertial><origin xyz="0 0 0.15"/><mass value="0.5"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <link name="plate"/>
  <link name="tip"/>
  <joint name="mount" type="fixed"><parent link="world"/><child link="bench"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.4 -0.2 0.9"/></joint>
  <joint name="swing" type="continuous"><parent link="bench"/><child link="swing"/>
    <origin xyz="0 0 0.5" rpy="0.1 0.2 0.3"/>
    <axis xyz="1 2 3"/></joint>
  <joint name="lift" type="prismatic"><parent link="swing"/><child link="carriage"/>
    <origin xyz="0.3 0 0.1" rpy="0 1.2 0"/>
    <axis xyz="0 0 -1"/><limit lower="-0.2" upper="0.4" effort="1" velocity="1"/></joint>
  <joint name="follow" type="revolute"><parent link="carriage"/><child link="follower"/>
    <origin xyz="0.05 0.4 0" rpy="0 0 -0.7"/>
    <axis xyz="0 0.6 0.8"/><limit lower="-3" upper="3" effort="1" velocity="1"/>
    <mimic joint="swing" multiplier="-0.5" offset="0.3"/></joint>
  <joint name="hang" type="fixed"><parent link="follower"/><child link="loose"/>
    <origin xyz="0 0.1 0.2" rpy="0.2 0 0"/></joint>
  <joint name="turn" type="revolute"><parent link="loose"/><child link="wrist"/>
    <origin xyz="0 0 0.3"/>
    <axis xyz="-1 0 0"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <joint name="flap" type="revolute"><parent link="carriage"/><child link="flap"/>
    <origin xyz="0 0 0.2" rpy="1 0 0"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
  <joint name="plate_mount" type="fixed"><parent link="wrist"/><child link="plate"/>
    <origin xyz="0 0 0.1" rpy="0 1.5707963267948966 0"/></joint>
  <joint name="tip_mount" type="fixed"><parent link="plate"/><child link="tip"/>
    <origin xyz="0.1 0 0"/></joint>
</robot>
"""

STANDARD_DH = """
convention = "standard"
gravity_m_s2 = [0, 9.81, 0]
[base]
xyz_mm = [10, 20, 30]
rpy_deg = [10, 20, 30]
[tool]
xyz_in = [0, 0, 1]
rpy_rad = [0.1, 0, 0]
[[joint]]
d_mm = 400
alpha_deg = 90
a_mm = 25
mass_kg = 20
com_mm = [-10, 0, 30]
[[joint]]
a_m = 0.45
theta_rad = 0.5
sign = -1
mass_kg = 9
com_mm = [-200, 0, 10]
[[joint]]
name = "reach"
kind = "prismatic"
alpha_deg = -40
theta_deg = 15
d_mm = 100
lower_mm = -50
upper_mm = 200
mass_kg = 4
[[joint]]
alpha_deg = 90
[[coupling]]
joint = "J4"
follows = "J1"
factor = 0.25
"""

NAMED = ("irb6400r", "irb6400r-2.8", "ur5", "ur10", "panda", "kinova", "so100", "talos_arm", "xarm7", "z1")
WRITTEN = {"odd.urdf": ODD_URDF, "standard.toml": STANDARD_DH}
CASES = (*NAMED, *WRITTEN)


def robot(case: str, folder: Path) -> SerialChain:
    """The robot of a case; those of WRITTEN are read from a file put in the folder."""
    if case in WRITTEN:
        (folder / case).write_text(WRITTEN[case])
        case = str(folder / case)
    chain = load_mechanism(case, payload_com=(0.02, -0.03, 0.1))
    assert chain is not None
    return chain


def poses(mechanism: Mechanism, rng: np.random.Generator, count: int = 8) -> Array:
    """Joint values (count, n) within limits, and within a turn and a half where there are none."""
    lower = np.array([max(joint.lower, -4.7) for joint in mechanism.joints])
    upper = np.array([min(joint.upper, 4.7) for joint in mechanism.joints])
    return rng.uniform(lower, upper, (count, len(mechanism.joints)))


def slot_frames(mechanism: Mechanism, q: Array) -> Array:
    """Frames (S, N, 4, 4) of the slots in the root frame."""
    transforms = mechanism.transforms(q)
    frames = [transforms[0]]
    for transform in transforms[1:]:
        frames.append(frames[-1] @ transform)
    return np.array(frames)
