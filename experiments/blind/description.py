"""The description of an arm that its user has: URDF, with the masses or without."""

from __future__ import annotations

import numpy as np

from experiments.blind.simulator import Arm, Array


def rpy(rotation: Array) -> tuple[float, float, float]:
    """Fixed-axis roll, pitch, yaw of URDF: Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return float(roll), float(pitch), float(yaw)


def urdf(arm: Arm, masses: bool = True) -> str:
    """The nominal arm as URDF: masses and centres of mass if wanted, no meshes, limits wider than the poses."""
    text = [f'<?xml version="1.0"?>\n<robot name="{arm.name}">\n  <link name="base"/>']
    for i, (mass, centre, origin) in enumerate(zip(arm.masses, arm.centres, arm.origins(), strict=True)):
        slides = i + 1 in arm.prismatic
        low, high = arm.limits[i] + (np.array([-0.1, 0.1]) if slides else np.radians([-5.0, 5.0]))
        parent = "base" if i == 0 else f"link_{i}"
        xyz = " ".join(f"{v:.12g}" for v in origin[:3, 3])
        angles = " ".join(f"{v:.15g}" for v in rpy(origin[:3, :3]))
        inertia = 0.01 * mass
        inertial = (
            f'>\n    <inertial>\n      <origin xyz="{centre[0]:.9g} {centre[1]:.9g} {centre[2]:.9g}" rpy="0 0 0"/>\n'
            f'      <mass value="{mass:.9g}"/>\n'
            f'      <inertia ixx="{inertia:.9g}" ixy="0" ixz="0" iyy="{inertia:.9g}" iyz="0" izz="{inertia:.9g}"/>\n'
            f"    </inertial>\n  </link>\n"
        )
        text.append(
            f'  <link name="link_{i + 1}"{inertial if masses else "/>" + chr(10)}'
            f'  <joint name="J{i + 1}" type="{"prismatic" if slides else "revolute"}">\n'
            f'    <parent link="{parent}"/>\n    <child link="link_{i + 1}"/>\n'
            f'    <origin xyz="{xyz}" rpy="{angles}"/>\n    <axis xyz="0 0 1"/>\n'
            f'    <limit lower="{low:.9g}" upper="{high:.9g}" effort="1000" velocity="3"/>\n  </joint>'
        )
    return "\n".join([*text, "</robot>\n"])
