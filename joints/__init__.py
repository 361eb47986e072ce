"""Precision spherical joints as mechanisms: the single joint, machines with twelve joints, and models for the design of
the joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gpmodel.errors import InputError

if TYPE_CHECKING:
    from joints.hexapod import Hexapod, Tau
    from joints.passive_joint import PassiveJoint

SPHERICAL_JOINT, HEXAPOD, TAU = "spherical-joint", "hexapod", "tau"


def mechanism_names() -> tuple[str, ...]:
    """Return the names that load_mechanism accepts without a file."""
    return (SPHERICAL_JOINT, HEXAPOD, TAU)


def spherical_joint() -> PassiveJoint:
    """Return the spherical joint of the thesis on its test rig."""
    from joints.passive_joint import spherical_joint as described

    return described()


def load_mechanism(
    name: str, *, frame: str | None = None, payload_com: Sequence[float] | None = None
) -> PassiveJoint | Hexapod | Tau | None:
    """Load the joint, hexapod or Tau robot `name`, or of the `kind` in a TOML file; return None for any other name.

    frame: name of the measured frame; only `TCP`, the measured point, is accepted.
    payload_com: centre of mass of the payload relative to the measured point, 3 coordinates in m, in the axes of the
    last rotation or of the platform.
    Raises InputError for a frame other than `TCP` or an invalid file.
    """
    from joints.passive_joint import vector

    machine = _described(name)
    if machine is None:
        return None
    if frame not in (None, "TCP"):
        raise InputError(f"{name}: no frame named {frame!r}, expected 'TCP'")
    return machine if payload_com is None else replace(machine, payload_com=vector(payload_com))


def _described(name: str) -> PassiveJoint | Hexapod | Tau | None:
    from joints.hexapod import hexapod, tau
    from joints.passive_joint import kind_of, read_joint

    if name == SPHERICAL_JOINT:
        return spherical_joint()
    path = Path(name) if Path(name).suffix.lower() == ".toml" else None
    kind = kind_of(path) if path else name
    if kind in (HEXAPOD, TAU):
        return hexapod(path) if kind == HEXAPOD else tau(path)
    return read_joint(path) if path and kind is not None else None


__all__ = ["load_mechanism", "mechanism_names", "spherical_joint"]
