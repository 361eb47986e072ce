"""An arm of ur_description, built from a kinematics file as by urdf/ur_macro.xacro."""

from collections.abc import Mapping

UR5E = {
    "shoulder": (0.0, 0.0, 0.1625, 0.0, 0.0, 3.14159265359),
    "upper_arm": (0.0, 0.0, 0.0, 1.570796327, 0.0, 0.0),
    "forearm": (-0.425, 0.0, 0.0, 0.0, 0.0, 0.0),
    "wrist_1": (-0.3922, 0.0, 0.1333, 0.0, 0.0, 0.0),
    "wrist_2": (0.0, -0.0997, -2.044881182297852e-11, 1.570796327, 0.0, 0.0),
    "wrist_3": (0.0, 0.0996, -2.042830148012698e-11, 1.570796326589793, 3.141592653589793, 3.141592653589793),
}
"""x, y, z, m, roll, pitch, yaw, rad: config/ur5e/default_kinematics.yaml."""

JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def ur_urdf(kinematics: Mapping[str, tuple[float, ...]] = UR5E) -> str:
    """Its URDF, without meshes and masses."""
    parts = ['<robot name="ur5e"><link name="base_link"/>']
    parts.append(fixed("base_link-base_link_inertia", "base_link", "base_link_inertia", "0 0 3.141592653589793"))
    parent = "base_link_inertia"
    for joint, (link, numbers) in zip(JOINTS, kinematics.items(), strict=True):
        xyz, rpy = (" ".join(map(repr, part)) for part in (numbers[:3], numbers[3:]))
        parts.append(
            f'<link name="{link}_link"/><joint name="{joint}_joint" type="revolute"><parent link="{parent}"/>'
            f'<child link="{link}_link"/><origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/>'
            '<limit lower="-3.14" upper="3.14" effort="1" velocity="1"/></joint>'
        )
        parent = f"{link}_link"
    parts.append(fixed("wrist_3-flange", parent, "flange", "0 -1.5707963267948966 -1.5707963267948966"))
    parts.append(fixed("flange-tool0", "flange", "tool0", "1.5707963267948966 0 1.5707963267948966"))
    return "".join(parts) + "</robot>"


def fixed(name: str, parent: str, child: str, rpy: str) -> str:
    return (
        f'<link name="{child}"/><joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 0" rpy="{rpy}"/></joint>'
    )
