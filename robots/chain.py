"""A serial chain of revolute and prismatic joints, as a Mechanism."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.extras import extra_for
from gpmodel.mechanism.protocol import Joint
from gpmodel.table.units import identifier
from robots.links import Chain
from robots.statics import gravity_loads, unit_loads
from robots.urdf_export import write_calibrated_urdf
from robots.urdf_file import has_geometry
from robots.urdf_tree import read_tree

if TYPE_CHECKING:
    from robots.collision import Shape


@dataclass(frozen=True, eq=False)
class SerialChain(Chain):
    """A chain of links driven by table coordinates: a Mechanism."""

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        return tuple(self._joint(column) for column in range(len(self.joint_names)))

    @property
    def bodies(self) -> dict[str, tuple[float, Array]]:
        """Slot -> mass, kg, and its centre (3,) in the frame of the slot, m."""
        return {f"{link.name}.moving": (link.mass, link.com) for link in self.links if link.mass}

    @cached_property
    def link_slots(self) -> dict[str, str]:
        """Link -> the slot of the last motion before it, empty where it stands still; none where it was read from no
        URDF."""
        if self.source is None:
            return {}
        tree, own = read_tree(self.source), [link.name for link in self.links]
        out = {}
        for link in tree.frames:
            before = [name for j in tree.route(link) if (name := identifier(j.name)) in own]
            out[link] = f"{before[-1]}.moving" if before else ""
        return out

    def _joint(self, column: int) -> Joint:
        weights = self.coupling[:, column]
        drive = tuple(
            (f"{link.name}.moving", link.axis, float(weight))
            for link, weight in zip(self.links, weights, strict=True)
            if weight
        )
        kind = "revolute" if drive[0][1].startswith("R") else "prismatic"
        lower, upper = (float(limit) for limit in self.limits[column])
        return Joint(self.joint_names[column], kind, lower, upper, drive)

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Return the gravity loads on the arm at rest, each (N,): the load itself, not the reaction that holds it.

        torque_J (Nm; N for a prismatic joint): generalized force of gravity on the coordinate J, positive
        where gravity drives it upwards, so that `deflection = compliance * torque` has a positive compliance.
        force_J_x .. moment_J_z (N, Nm): wrench that the weight of everything beyond J exerts at the origin of
        J.moving, in its axes; force_base_x .. moment_base_z likewise for the whole arm in the root frame,
        about its origin. payload: (N,) kg at `payload_com`. Empty where nothing weighs anything.
        Source: sums of weights and lever arms; recursive Newton-Euler at rest (Featherstone 2008, ch. 5) agrees.
        """
        return gravity_loads(self, q, payload)

    def unit_loads(self, q: Array) -> dict[str, Array]:
        """Loads of each link's weight, of unit moments and of its own mass, as `Weighed` states them."""
        return unit_loads(self, q)

    @cached_property
    def _shape(self) -> Shape | None:
        if self.source is None or not has_geometry(self.source):
            return None
        with extra_for("where the arm meets itself"):
            from robots.collision import Shape

        return Shape.read(self.source, self.joint_names, self.tool_frame)

    @property
    def has_shape(self) -> bool:
        """True if the URDF has collision geometry whose meshes exist."""
        return self._shape is not None

    def collides(self, q: Array) -> Mask:
        """Return where the arm collides with itself (N,) at q (N, n); never without a shape."""
        return np.zeros(len(q), dtype=bool) if self._shape is None else self._shape.collides(q)

    def hides(self, q: Array, points: Array, instrument: Array) -> Mask:
        """Return where the arm blocks the line (N,) from points (N, 3), m, in the root frame to the instrument (3,)."""
        return np.zeros(len(q), dtype=bool) if self._shape is None else self._shape.hides(q, points, instrument)

    def write_urdf(self, path: Path, twists: Mapping[str, Array] | None = None) -> str:
        """Writes the chain with constant error twists, by slot, as URDF; see robots.urdf_export."""
        return write_calibrated_urdf(self, twists or {}, path)
