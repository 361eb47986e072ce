"""Precision spherical joints: the joint as a mechanism, and the models it is designed with."""

from collections.abc import Sequence
from dataclasses import replace

from gpmodel.errors import InputError
from joints.kinematics import SphericalJoint, vector
from joints.settings import load_settings

SPHERICAL_JOINT = "spherical-joint"


def mechanism_names() -> tuple[str, ...]:
    """Names that load_mechanism knows."""
    return (SPHERICAL_JOINT,)


def spherical_joint() -> SphericalJoint:
    """The thesis' joint on its test rig."""
    s = load_settings("spherical_joint")
    limits = tuple((float(s[name][0]), float(s[name][1])) for name in ("roll", "pitch", "yaw"))
    return SphericalJoint(vector(s["tooling_ball"]), limits, vector(s["gravity"]))


def load_mechanism(
    name: str, *, frame: str | None = None, payload_com: Sequence[float] | None = None
) -> SphericalJoint | None:
    """The mechanism `name`, None where it is no joint.

    frame: only `TCP`, the centre of the tooling ball. payload_com: (3,) m from there, in the frame after the yaw.
    Raises InputError for another frame.
    """
    if name != SPHERICAL_JOINT:
        return None
    if frame not in (None, "TCP"):
        raise InputError(f"{name}: no frame named {frame!r} to measure at; it has 'TCP'")
    joint = spherical_joint()
    return joint if payload_com is None else replace(joint, payload_com=vector(payload_com))
