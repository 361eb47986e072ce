"""Specification of an instrument: the maximum permissible error of a coordinate at a distance."""

import math
import re
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.table.units import convert, parse_quantity

LARGEST = 1.0
"""Metres, and metres a metre: of no instrument."""
EXPECTED = (
    "expected the largest error of a coordinate, an offset and a slope or one of them, at most 1 m and 1 m/m, "
    "as in '15um + 6um/m'"
)
SHOWN = 60
"""Characters of a text that a message shows."""
COVERAGE = 2.0
"""Standard deviations that a stated limit stands for. Source: JCGM 100 (2008), 6.2: expanded uncertainty, k = 2."""


@dataclass(frozen=True)
class Specification:
    """U(r) = offset + slope r of a coordinate, m, at the distance r, m, from the instrument.

    Source: ISO 10360-10, maximum permissible error.
    """

    offset: float
    slope: float

    def distance(self, points: Array) -> float:
        """The typical distance (RMS), m, of points (N, 3), m, in the instrument's frame; NaN ones left out."""
        whole = points[np.isfinite(points).all(axis=1)]
        return float(np.sqrt(np.mean(np.sum(whole**2, axis=1)))) if len(whole) else 0.0

    def at(self, points: Array) -> float:
        """U, m, at the typical distance of points."""
        return self.offset + self.slope * self.distance(points)

    def noise(self, points: Array) -> float:
        """The standard deviation of a coordinate, m, that it leads to expect at points (N, 3), m."""
        return self.at(points) / COVERAGE

    def __str__(self) -> str:
        return f"{1e6 * self.offset:g} µm + {1e6 * self.slope:g} µm/m"


def specification(text: str) -> Specification:
    """`15um + 6um/m`, `±0.02 mm`, `10 µm + 5 ppm`. Raises InputError naming `instrument`."""
    offset, slope = 0.0, 0.0
    try:
        for part in re.split(r"(?<=[^eE+])\+", text.strip().strip("±()")):
            if re.search(r"/|ppm", part):
                slope += convert(part.replace("ppm", "um/m"), "1", "instrument")
            else:
                offset += parse_quantity(part, "length", "instrument")
    except InputError:
        offset = math.nan
    if not (math.isfinite(offset + slope) and min(offset, slope) >= 0.0 < max(offset, slope) <= LARGEST):
        raise InputError(f"{text[:SHOWN]!r}, {EXPECTED}", "instrument")
    return Specification(offset, slope)
