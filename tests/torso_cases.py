"""URDF of two arms on one torso."""

import re

ARM = (("0 0 0.1", "0 0 1"), ("0 0 0.1", "0 1 0"), ("0 0 0.35", "0 1 0"), ("0.1 0 0.3", "1 0 0"), ("0.1 0 0", "0 1 0"))
TIPS = "left_tool,right_tool"
MASS = (
    '<inertial><origin xyz="0.1 0 0"/><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
)


def joint(name: str, kind: str, parent: str, child: str, xyz: str, axis: str, rpy: str = "0 0 0") -> str:
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
    )


def torso(weighty: bool = False) -> str:
    """URDF of two arms of five joints on one torso; weighty: with a kilogram in every link."""
    parts = [
        '<robot name="torso"><link name="floor"/>',
        joint("torso", "revolute", "floor", "chest", "0 0 0.5", "0 0 1"),
    ]
    for side, y, roll in (("left", 0.2, -0.8), ("right", -0.2, 0.8)):
        parent = "chest"
        for k, (xyz, axis) in enumerate(ARM):
            first = (f"0 {y} 0.3", f"{roll} 0 0") if k == 0 else (xyz, "0 0 0")
            parts.append(joint(f"{side}_{k}", "revolute", parent, f"{side}_link_{k}", first[0], axis, first[1]))
            parent = f"{side}_link_{k}"
        parts.append(joint(f"{side}_mount", "fixed", parent, f"{side}_tool", "0.1 0 0", "1 0 0"))
    text = "".join(parts) + "</robot>"
    return re.sub(r'<link name="(\w+_link_\d)"/>', rf'<link name="\1">{MASS}</link>', text) if weighty else text
