"""Parts of a serial chain, and the properties that statics and export read."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, GRAVITY
from gpmodel.numerics import se3


def along(axis: str, value: float) -> Array:
    """Transform (4, 4) of one motion by value, rad about or m along the axis, one of AXES."""
    return np.asarray(se3.along(AXES.index(axis), np.array([value]))[0])


def placement(xyz: ArrayLike, rpy: ArrayLike) -> Array:
    """Transform (4, 4) that turns by Rz(yaw) Ry(pitch) Rx(roll), rad, and moves by xyz (3,), m."""
    roll, pitch, yaw = np.asarray(rpy, dtype=np.float64)
    return se3.shift(xyz) @ along("Rz", yaw) @ along("Ry", pitch) @ along("Rx", roll)


LONGEST_CHAIN = 64
"""Largest number of moving joints. Time and memory grow with its square; a snake robot has 20."""
DOWN = (0.0, 0.0, -GRAVITY)


@dataclass(frozen=True, eq=False)
class Link:
    """One motion of the chain and the rigid part it carries.

    name: the joint's. placement: (4, 4), the frame before this motion in the frame after the motion before
    (in the root, for the first), m. axis: one of gpmodel.mechanism.protocol.AXES, the coordinate axis of that frame
    the motion is about or along, in its positive sense. mass: kg. com: (3,) m, in the frame after the motion.
    alignment: (4, 4), the frame after the motion in the frame the source description gives the same part.
    offset: constant part of the motion already contained in placement, rad or m.
    """

    name: str
    placement: Array
    axis: str
    mass: float = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    alignment: Array = field(default_factory=lambda: np.eye(4))
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Chain:
    """Links driven by table coordinates.

        motion of the links  s = coupling @ q

    coupling: (len(links), len(joints)); the identity for an arm with one motor per joint, with other entries
    for a reversed axis, a parallel bar or a mimic joint. tool: (4, 4) from the frame after the last motion to
    the measured frame `tool_frame`, m. gravity: (3,) m/s^2 in the root frame. payload_com: (3,) m, centre of
    mass of the payload in the measured frame. source: the URDF file the chain was read from, if any.
    limits: (len(joints), 2), rad or m, in table coordinates. not_read: what is left out of the file.
    """

    name: str
    links: tuple[Link, ...]
    tool: Array
    joint_names: tuple[str, ...]
    coupling: Array
    limits: Array
    tool_frame: str = "tool"
    gravity: Array = field(default_factory=lambda: np.array(DOWN))
    payload_com: Array = field(default_factory=lambda: np.zeros(3))
    source: Path | None = None
    not_read: tuple[str, ...] = ()

    @cached_property
    def slots(self) -> tuple[str, ...]:
        """Frames at which errors act."""
        sides = (f"{link.name}.{side}" for link in self.links for side in ("fixed", "moving"))
        return ("base", *sides, "tool")

    def motions(self, q: Array) -> Array:
        """Motions (N, len(links)) of the links, rad and m, at table coordinates q (N, n)."""
        q = np.asarray(q, dtype=np.float64)
        if q.ndim != 2 or q.shape[1] != len(self.joint_names):
            raise InputError(
                f"{self.name}: joint values have shape {q.shape}, "
                f"expected (poses, {len(self.joint_names)}) for {', '.join(self.joint_names)}"
            )
        return q @ self.coupling.T

    def transforms(self, q: Array) -> Array:
        """Nominal transforms (S, N, 4, 4) between successive slots, as the Mechanism protocol states."""
        motions = self.motions(q)
        transforms = np.empty((len(self.slots), len(motions), 4, 4))
        transforms[0] = np.eye(4)
        for i, link in enumerate(self.links):
            transforms[1 + 2 * i] = link.placement
            transforms[2 + 2 * i] = se3.along(AXES.index(link.axis), motions[:, i])
        transforms[-1] = self.tool
        return transforms
