"""Columns of States that are worked out when the first of them is read."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.mechanism.protocol import Mechanism, Weighed, ball_jointed
from gpmodel.table.dataset import Specification

PREFIX = "instrument_"
UNITS = {"range": "m", "azimuth": "rad", "elevation": "rad", "x": "m", "y": "m", "z": "m"}


def seen_columns(points: Array) -> dict[str, Array]:
    """Columns (N,) of points (N, 3), m: instrument_range, _azimuth, _elevation, _x, _y, _z."""
    x, y, z = points.T
    flat = np.hypot(x, y)
    values = (np.hypot(flat, z), np.arctan2(y, x), np.arctan2(z, flat), x, y, z)
    return {f"{PREFIX}{name}": column for name, column in zip(UNITS, values, strict=True)}


@dataclass(frozen=True, eq=False)
class Seen:
    """The points (N, 3) of a whole table as its instrument measured them, m; NaN where it did not. specification: of
    the instrument, where it is known."""

    points: Array
    specification: Specification | None = None

    @cached_property
    def columns(self) -> dict[str, Array]:
        """See `seen_columns`; where a point was not measured whole, those of the middle one."""
        whole: Mask = np.asarray(np.isfinite(self.points).all(axis=1))
        middle = np.median(self.points[whole], axis=0) if whole.any() else np.zeros(3)
        return seen_columns(np.where(whole[:, None], self.points, middle))

    def column(self, name: str) -> Array | None:
        """The column (N,) of that name, None where there is none."""
        return self.columns.get(name) if name.startswith(PREFIX) else None

    def unit(self, name: str) -> str:
        """m or rad."""
        return UNITS[name.removeprefix(PREFIX)]


@dataclass(frozen=True, eq=False)
class Derived:
    """Columns that one function makes of a whole table.

    made: them, (N,) by name. known: whether a name may be one of them, asked before they are made. unit: of a name.
    All three go to other processes: they are functions of a module.
    """

    made: Callable[[], Mapping[str, Array]]
    known: Callable[[str], bool]
    unit: Callable[[str], str]

    @cached_property
    def columns(self) -> Mapping[str, Array]:
        """All of them."""
        return self.made()

    def column(self, name: str) -> Array | None:
        """The column (N,) of that name, None where there is none."""
        return self.columns.get(name) if self.known(name) else None


def link_weights(mechanism: Mechanism, q: Array) -> Derived | None:
    """Return the joint torques of each link's weight, as `Weighed.unit_loads` gives them; None if they are unknown.

    In N·m; of a first moment of mass (`_of_J4_x`) in N·m a kg·m, which is m/s².
    """
    if not isinstance(mechanism, Weighed):
        return None
    return Derived(partial(mechanism.unit_loads, q), _of_a_link, _unit_of_weight)


def _of_a_link(name: str) -> bool:
    return "_of_" in name


def _unit_of_weight(name: str) -> str:
    return "m/s^2" if name[-2:] in ("_x", "_y", "_z") else "Nm"


def ball_angles(mechanism: Mechanism, q: Array) -> Derived | None:
    """Angles by which the balls of a mechanism turn, rad, but for those in the table; None without balls."""
    jointed = ball_jointed(mechanism)
    if jointed is None:
        return None
    names = {angle for ball in jointed.balls for angle in ball.angles}
    return Derived(partial(jointed.turned, q), names.__contains__, _unit_of_angle)


def _unit_of_angle(_: str) -> str:
    return "rad"
