"""Dataset: the measured table as immutable rows of poses, in SI units."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import QUOTED, InputError
from gpmodel.table.units import convert, joint_column, parse_quantity

LARGEST = 1.0
"""Largest accepted instrument specification: constant part, m, and slope, m/m."""
EXPECTED = (
    "expected the largest error of a coordinate, an offset and a slope or one of them, at most 1 m and 1 m/m, "
    "as in '15um + 6um/m'"
)
COVERAGE = 2.0
"""Ratio of a specified limit to the standard deviation. Source: JCGM 100 (2008), 6.2, k = 2."""


@dataclass(frozen=True)
class Specification:
    """Maximum permissible error of a coordinate, U(r) = offset + slope r, m, at distance r, m, from the instrument.
    Source: ISO 10360-10."""

    offset: float
    slope: float

    def distance(self, points: Array) -> float:
        """Return the RMS distance of points from the instrument at the origin, m; points with NaN are excluded.
        points: coordinates in the frame of the instrument, m."""
        whole = points[np.isfinite(points).all(axis=1)]
        return float(np.sqrt(np.mean(np.sum(whole**2, axis=1)))) if len(whole) else 0.0

    def at(self, points: Array) -> float:
        """Return the permissible error of a coordinate, m, at the RMS distance of points, m, from the instrument."""
        return self.offset + self.slope * self.distance(points)

    def noise(self, points: Array) -> float:
        """Return the expected standard deviation of a coordinate of points, m: half the permissible error."""
        return self.at(points) / COVERAGE

    def __str__(self) -> str:
        return f"{1e6 * self.offset:g} µm + {1e6 * self.slope:g} µm/m"


def specification(text: str) -> Specification:
    """Parse a specification such as `15um + 6um/m`, `±0.02 mm`, `10 µm + 5 ppm`.
    Raises InputError naming `instrument`."""
    parts = re.split(r"(?<=[^eE+])\+", text.strip().strip("±()"))
    slopes = [part for part in parts if re.search(r"/|ppm", part)]
    offsets = [part for part in parts if part not in slopes]
    try:
        slope = sum(convert(part.replace("ppm", "um/m"), "1", "instrument") for part in slopes)
        offset = sum(parse_quantity(part, "length", "instrument") for part in offsets)
    except InputError:
        offset = slope = math.nan
    if max(len(slopes), len(offsets)) > 1 or not (
        math.isfinite(offset + slope) and min(offset, slope) >= 0.0 < max(offset, slope) <= LARGEST
    ):
        raise InputError(f"{text[:QUOTED]!r}, {EXPECTED}", "instrument")
    return Specification(offset, slope)


TOUCHED = ("on_plane", "on_sphere", "on_line", "same_point", "pair")
"""Table columns with the name of the object that the tool point touched."""

READ = (*TOUCHED, "camera", "marker", "link", "tip")
"""Table columns with the name of the measured object. Rows with different objects are not repeats."""

LABELS = ("group", "repeat", "setup", "tool", *READ)

READINGS = {"u": "px", "v": "px", "length": "m", "inclination_x": "rad", "inclination_y": "rad"}
"""Table columns of instruments that do not measure points (pixels, inclinations, lengths), and their SI units."""


class Readings(Protocol):
    """Interface of measurements other than points, orientations and distances; see gpmodel.model.observation."""

    def subset(self, rows: IntArray) -> "Readings":
        """Return the measurements at the poses with the given row numbers."""


@dataclass(frozen=True)
class Dataset:
    """Measured poses of a mechanism; every array has one row per pose.

    q: joint values, rad or m, a column per joint in the order of the mechanism.
    position: x, y, z in the frame of the instrument, m, NaN where not measured.
    rotation: rotation vectors in the frame of the instrument, rad, NaN where not measured.
    row: number of the data row in the file, from 1.
    payload: mass at the tool, kg. payload_given: True if the table has a column of payloads.
    distances: measured distances, m, by name.
    readings: columns of instruments such as cameras, by name.
    described: content of the description files, by "cameras", "board" and "surfaces".
    observations: measurements other than points, poses and distances.
    labels: text of each row by label column, "" for an empty cell.
    extras: further columns by name, in `extra_units`; extra_names: their names in the table.
    sha256: digest of the bytes of the file.
    columns: names of the joints in the table, if the names in the mechanism differ.
    kinds: kind of each joint (revolute or prismatic), "revolute" if empty.
    joints_approximate: True if a joint has no sensor, so that equal joint values need not be one pose.
    ignored: text columns that are no labels; empty_rows: number of empty rows in the file.
    in_order: True if rows are in the order of measurement, so that effects may depend on earlier rows.
    instrument: specification of the instrument; None if not stated.
    convention: text of the controller's convention, see `gpmodel.table.convention`; "" if not known.
    """

    joints: tuple[str, ...]
    q: Array
    position: Array
    rotation: Array
    row: IntArray
    payload: Array
    distances: Mapping[str, Array] = field(default_factory=dict)
    readings: Mapping[str, Array] = field(default_factory=dict)
    described: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    observations: tuple[Readings, ...] = ()
    labels: Mapping[str, NDArray[np.str_]] = field(default_factory=dict)
    extras: Mapping[str, Array] = field(default_factory=dict)
    extra_units: Mapping[str, str] = field(default_factory=dict)
    payload_given: bool = False
    source: str = "table"
    sha256: str = ""
    columns: tuple[str, ...] = ()
    joints_approximate: bool = False
    ignored: tuple[str, ...] = ()
    empty_rows: int = 0
    in_order: bool = False
    extra_names: Mapping[str, str] = field(default_factory=dict)
    kinds: tuple[str, ...] = ()
    instrument: Specification | None = None
    convention: str = ""

    def __post_init__(self) -> None:
        for name in ("q", "position", "rotation", "row", "payload"):
            getattr(self, name).setflags(write=False)
        for name in ("distances", "readings", "described", "labels", "extras", "extra_units", "extra_names"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: slice) -> "Dataset":
        """Return the rows of a slice: `table[:10]`. Raises InputError if `rows` is not a slice."""
        if not isinstance(rows, slice):
            raise InputError(
                f"table[{rows!r}], expected a slice, as in table[:10]; columns are those of to_dataframe()"
            )
        return self.subset(np.arange(len(self))[rows])

    def __repr__(self) -> str:
        """Return one line with the source, the number of poses and the joints."""
        names = ", ".join(self.columns or self.joints)
        measured = int(np.isfinite(self.position).all(axis=1).sum())
        return f"<table {self.source}: {len(self)} poses of {names}, {measured} with x, y, z>"

    def to_dataframe(self) -> pd.DataFrame:
        """Return the table as a DataFrame with units in the headers, in the order of the file format.
        Joints and angles are in [deg], lengths in [mm], pixels in [px]; every further column keeps its own name and
        unit."""
        columns: dict[str, object] = {"row": self.row}
        kinds = self.kinds or ("revolute",) * len(self.joints)
        for name, kind, values in zip(self.columns or self.joints, kinds, self.q.T, strict=True):
            columns |= [joint_column(name, kind, values)]
        for name, values in self.extras.items():
            columns[f"{self.extra_names.get(name, name)} [{self.extra_units[name]}]"] = values
        columns |= {"payload [kg]": self.payload} if self.payload_given else {}
        columns |= dict(self.labels)
        columns |= {f"{a} [mm]": 1e3 * self.position[:, i] for i, a in enumerate("xyz")}
        if self.has_rotation:
            columns |= {f"r{a} [deg]": np.degrees(self.rotation[:, i]) for i, a in enumerate("xyz")}
        columns |= {f"{name} [mm]": 1e3 * values for name, values in self.distances.items()}
        for name, values in self.readings.items():
            unit, factor = {"px": ("px", 1.0), "m": ("mm", 1e3), "rad": ("deg", 180.0 / np.pi)}[READINGS[name]]
            columns[f"{name} [{unit}]"] = factor * values
        return pd.DataFrame(columns)

    @property
    def has_rotation(self) -> bool:
        """True if any orientation was measured."""
        return bool(np.isfinite(self.rotation).any())

    def label(self, column: str) -> NDArray[np.str_]:
        """Return the text of each row in a label column such as `setup`, "" if the table lacks this label column."""
        return self.labels.get(column, np.full(len(self), "", dtype="<U1"))

    def codes(self, column: str) -> tuple[list[str], IntArray]:
        """Return the distinct texts of a label column in order of appearance, and the index of each row's text."""
        if column not in self.labels:
            return [""][: len(self)], np.zeros(len(self), dtype=np.int64)
        labels = self.label(column)
        names = list(dict.fromkeys(labels.tolist()))
        index = {name: i for i, name in enumerate(names)}
        return names, np.array([index[x] for x in labels.tolist()], dtype=np.int64)

    def subset(self, rows: IntArray | Sequence[int] | NDArray[np.bool_]) -> "Dataset":
        """Return a table of some rows, given by their numbers or by a mask."""
        take = np.asarray(rows)
        return replace(
            self,
            q=self.q[take],
            position=self.position[take],
            rotation=self.rotation[take],
            row=self.row[take],
            payload=self.payload[take],
            distances={k: v[take] for k, v in self.distances.items()},
            readings={k: v[take] for k, v in self.readings.items()},
            observations=tuple(o.subset(take) for o in self.observations),
            labels={k: v[take] for k, v in self.labels.items()},
            extras={k: v[take] for k, v in self.extras.items()},
        )


SAME_MASS = 1e-9
"""Largest relative difference of two masses that count as equal: nine written digits."""


def with_payload(dataset: Dataset, payload: float | None) -> Dataset:
    """Return the table with `payload` (kg) in every row; None leaves the table unchanged.
    Raises InputError if a payload column of the table holds another mass."""
    if payload is None:
        return dataset
    if dataset.payload_given:
        other = dataset.payload[np.abs(dataset.payload - payload) > SAME_MASS * payload]
        if len(other):
            there = f"the payload column of {dataset.source} has {other[0]:g} kg"
            raise InputError(f"{payload:g} kg, and {there}; expected one of the two", "payload")
        return dataset
    return replace(dataset, payload=np.full(len(dataset), payload))


def unmeasured(joints: Sequence[str], q: Array, payload: Array | None = None, kinds: Sequence[str] = ()) -> Dataset:
    """Make a table of joint values q, rad or m, without measurements. payload: kg for each pose, by default zero."""
    count = len(q)
    missing = np.full((count, 3), np.nan)
    return Dataset(
        tuple(joints), q, missing, missing.copy(), np.arange(1, count + 1),
        np.zeros(count) if payload is None else payload, payload_given=payload is not None, kinds=tuple(kinds),
    )  # fmt: skip
