"""Where the instrument sees a point: the columns its own errors follow, in its own frame.

    range r = |p|,   azimuth a = atan2(y, x),   elevation e = atan2(z, hypot(x, y))

The origin of the measured coordinates is the instrument's own and its standing axis z, as of a laser tracker that was
not aligned to anything else.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.table.specification import Specification

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
