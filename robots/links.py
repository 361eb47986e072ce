"""Classes of the parts of a serial chain, with the properties for statics and export."""

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
    """Return the transform (4, 4) of a motion about (value in rad) or along (value in m) an axis such as "Rz"."""
    return np.asarray(se3.along(AXES.index(axis), np.array([value]))[0])


def placement(xyz: ArrayLike, rpy: ArrayLike) -> Array:
    """Return the transform (4, 4) with rotation Rz(yaw) Ry(pitch) Rx(roll), rad, and translation xyz (3,), m."""
    roll, pitch, yaw = np.asarray(rpy, dtype=np.float64)
    return se3.shift(xyz) @ along("Rz", yaw) @ along("Ry", pitch) @ along("Rx", roll)


LONGEST_CHAIN = 64
"""Largest number of moving joints of a chain; time and memory grow with its square. A snake robot has 20 joints."""
DOWN = (0.0, 0.0, -GRAVITY)


@dataclass(frozen=True, eq=False)
class Link:
    """One motion of the chain and the rigid part that it carries.

    name: name of the joint that moves the link.
    placement: pose (4, 4), m, of the frame before the motion, in the frame after the preceding motion (for the first
    motion, in the root frame).
    axis: coordinate axis about or along which the link moves, "Tx" to "Tz" or "Rx" to "Rz".
    mass: mass of the link, kg. com: centre of mass (3,), m, in the frame after the motion.
    alignment: pose (4, 4) of the frame after the motion, in the frame of the part in the source description.
    offset: constant part of the motion, rad or m, which is included in placement.
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
    """Links driven by joint coordinates q: motions of the links = coupling @ q.

    coupling: matrix (links, joints), the identity for an arm with one motor per joint. A reversed axis, a parallel bar
    or a mimic joint adds other entries.
    tool: pose (4, 4) of the measured frame `tool_frame` in the frame after the last motion, m.
    gravity: acceleration of gravity (3,), m/s², in the root frame.
    payload_com: centre of mass (3,) of the payload in the measured frame, m.
    source: URDF file of the chain, if any.
    limits: lower and upper limit of each joint coordinate, (joints, 2), rad or m.
    not_read: parts of the file that are ignored.
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
        """Names of the slots (frames at which errors act)."""
        sides = (f"{link.name}.{side}" for link in self.links for side in ("fixed", "moving"))
        return ("base", *sides, "tool")

    def motions(self, q: Array) -> Array:
        """Return the motions (poses, links) of the links, rad and m, at joint coordinates q (poses, joints)."""
        q = np.asarray(q, dtype=np.float64)
        if q.ndim != 2 or q.shape[1] != len(self.joint_names):
            raise InputError(
                f"{self.name}: joint values have shape {q.shape}, "
                f"expected (poses, {len(self.joint_names)}) for {', '.join(self.joint_names)}"
            )
        return q @ self.coupling.T

    def transforms(self, q: Array) -> Array:
        """Return nominal transforms (slots, poses, 4, 4), m, between successive frames; see the Mechanism protocol."""
        motions = self.motions(q)
        transforms = np.empty((len(self.slots), len(motions), 4, 4))
        transforms[0] = np.eye(4)
        for i, link in enumerate(self.links):
            transforms[1 + 2 * i] = link.placement
            transforms[2 + 2 * i] = se3.along(AXES.index(link.axis), motions[:, i])
        transforms[-1] = self.tool
        return transforms
