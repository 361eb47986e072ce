"""What a serial chain is made of, and what its statics and its export read of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from gpmodel.arrays import Array


def zero_vector() -> Array:
    """(0, 0, 0)."""
    return np.zeros(3)


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
    com: Array = field(default_factory=zero_vector)
    alignment: Array = field(default_factory=lambda: np.eye(4))
    offset: float = 0.0


class Chain(Protocol):
    """Links driven by table coordinates, as SerialChain states them."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    @property
    def links(self) -> tuple[Link, ...]:
        """From the root to the tool."""
        ...

    @property
    def tool(self) -> Array:
        """(4, 4) from the frame after the last motion to the measured frame, m."""
        ...

    @property
    def tool_frame(self) -> str:
        """Name of the measured frame."""
        ...

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The table's coordinates."""
        ...

    @property
    def coupling(self) -> Array:
        """(links, joints): motions per coordinate."""
        ...

    @property
    def limits(self) -> Array:
        """(joints, 2), rad or m, in table coordinates."""
        ...

    @property
    def gravity(self) -> Array:
        """(3,) m/s^2 in the root frame."""
        ...

    @property
    def payload_com(self) -> Array:
        """(3,) m in the measured frame."""
        ...

    @property
    def source(self) -> Path | None:
        """The URDF file it was read from."""
        ...

    @property
    def slots(self) -> tuple[str, ...]:
        """Frames at which errors act."""
        ...

    def motions(self, q: Array) -> Array:
        """Motions (N, links), rad and m, at table coordinates q (N, n)."""
        ...

    def transforms(self, q: Array) -> Array:
        """Nominal transforms (S, N, 4, 4) between successive slots."""
        ...
