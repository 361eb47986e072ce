"""Precision spherical joints: the joint as a mechanism, and the models it is designed with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gpmodel.errors import InputError

if TYPE_CHECKING:
    from joints.passive_joint import PassiveJoint

SPHERICAL_JOINT = "spherical-joint"


def mechanism_names() -> tuple[str, ...]:
    """Names that load_mechanism knows."""
    return (SPHERICAL_JOINT,)


def spherical_joint() -> PassiveJoint:
    """The thesis' joint on its test rig."""
    from joints.description import spherical_joint as described

    return described()


def load_mechanism(
    name: str, *, frame: str | None = None, payload_com: Sequence[float] | None = None
) -> PassiveJoint | None:
    """The joint `name`, or that of a TOML file which says its kind; None where it is no joint.

    frame: only `TCP`, the centre of the tooling ball. payload_com: (3,) m from there, in the frame after the last
    rotation. Raises InputError for another frame or a bad file.
    """
    from joints.description import describes_joint, read_joint
    from joints.passive_joint import vector

    if name == SPHERICAL_JOINT:
        joint = spherical_joint()
    elif Path(name).suffix.lower() == ".toml" and describes_joint(Path(name)):
        joint = read_joint(Path(name))
    else:
        return None
    if frame not in (None, "TCP"):
        raise InputError(f"{name}: no frame named {frame!r} to measure at; it has 'TCP'")
    return joint if payload_com is None else replace(joint, payload_com=vector(payload_com))


__all__ = ["load_mechanism", "mechanism_names", "spherical_joint"]
