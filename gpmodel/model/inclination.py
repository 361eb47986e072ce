"""An inclinometer on a link: the inclination of two of its axes to the horizontal.

An inclination is asin(s · up) for each sensor axis s = F M e, with the rotation F of the link, the rotation M of the
mounting, the unit vector e (x or y) and the vertical `up`. The vertical has an unknown tilt in the root frame. A
rotation about the vertical does not change the inclination.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.model.observation import METRES_A_RADIAN, OfLinks, Own, Tips
from gpmodel.numerics import se3

VERTICAL = "vertical"
FEWEST = 4
"""Least number of measurements of one inclinometer, whose axes have three unknowns each."""
STEEPEST = np.radians(89.9)
"""Largest usable inclination, rad. The sine of a larger angle hardly changes with the angle."""


@dataclass(frozen=True, eq=False)
class Inclination(OfLinks):
    """Measurements of inclinometers on links of a mechanism.

    values: measured inclinations (poses, 2), rad.
    links: name, and number of the frame, of each link with an inclinometer.
    link: position in `links` of the link at each pose, -1 for no measurement.
    """

    values: Array
    links: tuple[tuple[str, int], ...]
    link: IntArray
    name: ClassVar[str] = "inclination"
    metres: ClassVar[float] = METRES_A_RADIAN
    unit: ClassVar[str] = "rad"

    @cached_property
    def own(self) -> Mapping[str, tuple[str, ...]]:
        """Unknowns of the inclinometers: the tilt of the base and the mounting of each inclinometer."""
        return {VERTICAL: ("Rx", "Ry"), **{f"inclinometer {name}": ("Rx", "Ry", "Rz") for name, _ in self.links}}

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the mountings (fixed rotations) of the inclinometers on their links."""
        return tuple(f"inclinometer {name}" for name, _ in self.links)

    def subset(self, rows: IntArray) -> "Inclination":
        return replace(self, values=self.values[rows], link=self.link[rows])

    def residual(self, tips: Tips, own: Own) -> Array:
        rise = self._axes(tips, own) @ own[VERTICAL]
        return self.values - np.arcsin(np.clip(rise, -1.0, 1.0))

    def by_slots(self, tips: Tips, own: Own) -> Mapping[int, Array]:
        """Return the derivative of an inclination with respect to a rotation ω of a link: (s × up)·ω with the inclined
        axis s."""
        axes, out = self._axes(tips, own), {}
        change = np.cross(axes, own[VERTICAL]) * self._steep(axes, own)
        for i, (_, slot) in enumerate(self.links):
            turn = np.where((self.link == i)[:, None, None], change, 0.0)
            out[slot] = np.concatenate([np.zeros_like(turn), turn], axis=2)
        return out

    def by_own(self, tips: Tips, own: Own) -> Array:
        axes = self._axes(tips, own)
        steep = self._steep(axes, own)
        parts = [(np.cross(own[VERTICAL], axes) * steep)[:, :, :2]]
        for i, (name, slot) in enumerate(self.links):
            mounted = tips.slots[slot, :, :3, :3] @ _turn(own[f"inclinometer {name}"])
            up = np.einsum("nji,j->ni", mounted, own[VERTICAL])
            change = np.cross(np.eye(3)[:2], up[:, None, :]) * steep
            parts.append(np.where((self.link == i)[:, None, None], change, 0.0))
        return np.concatenate(parts, axis=2)

    def moved(self, key: str, value: Array, step: Array) -> Array:
        """Rotate the vertical in the root's axes, or the mounting of an inclinometer in its own axes."""
        if key == VERTICAL:
            return _turn(np.append(step, 0.0)) @ value
        return se3.rotation_vector(_turn(value) @ _turn(step))

    def start(self, tips: Tips) -> Own:
        """Return a level base, and mountings of inclinometers by least squares: the sine of an inclination is linear in
        the inclined axis."""
        out = {VERTICAL: np.array([0.0, 0.0, 1.0])}
        for i, (name, slot) in enumerate(self.links):
            rows = (self.link == i) & self.readings.all(axis=1)
            if rows.sum() < FEWEST:
                raise InputError(f"inclinometer '{name}': {int(rows.sum())} readings; expected at least {FEWEST}")
            x, y = np.linalg.lstsq(tips.slots[slot, rows, 2, :3], np.sin(self.values[rows]), rcond=None)[0].T
            turn = se3.nearest_rotation(np.column_stack([x, y, np.cross(x, y)]))
            out[f"inclinometer {name}"] = se3.rotation_vector(turn)
        return out

    def _axes(self, tips: Tips, own: Own) -> Array:
        """Return the axes x and y of the inclinometers in the root frame, (poses, 2, 3)."""
        out = np.zeros((len(self.values), 2, 3))
        for i, (name, slot) in enumerate(self.links):
            turn = tips.slots[slot, :, :3, :3] @ _turn(own[f"inclinometer {name}"])
            out[self.link == i] = np.swapaxes(turn[:, :, :2], 1, 2)[self.link == i]
        return out

    def _steep(self, axes: Array, own: Own) -> Array:
        """Return the derivative (poses, 2, 1) of each inclination with respect to its sine."""
        rise = axes @ own[VERTICAL]
        return np.asarray(1.0 / np.sqrt(np.maximum(1.0 - rise**2, np.cos(STEEPEST) ** 2)))[:, :, None]


def _turn(vector: Array) -> Array:
    return np.asarray(se3.exp(np.concatenate([np.zeros(3), vector]))[:3, :3])
