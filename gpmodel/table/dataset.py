"""The measured table: rows of poses, SI inside, immutable."""

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
"""Largest instrument specification, m and m/m."""
EXPECTED = (
    "expected the largest error of a coordinate, an offset and a slope or one of them, at most 1 m and 1 m/m, "
    "as in '15um + 6um/m'"
)
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
        raise InputError(f"{text[:QUOTED]!r}, {EXPECTED}", "instrument")
    return Specification(offset, slope)


TOUCHED = ("on_plane", "on_sphere", "on_line", "same_point", "pair")
"""Labels of what the tool point touched."""

READ = (*TOUCHED, "camera", "marker", "link", "tip")
"""Labels that say what a row reads: rows that differ in one are no repeats."""

LABELS = ("group", "repeat", "setup", "tool", *READ)

READINGS = {"u": "px", "v": "px", "length": "m", "inclination_x": "rad", "inclination_y": "rad"}
"""Columns of instruments that read no point, and their units here."""


class Readings(Protocol):
    """Readings at N poses of a kind that tables have no columns for: a gpmodel.model.observation.Observation."""

    def subset(self, rows: IntArray) -> "Readings":
        """Return the readings at some poses."""


@dataclass(frozen=True)
class Dataset:
    """N poses of a mechanism with n joints.

    q: (N, n) joint values, rad or m, in the mechanism's order. position: (N, 3) in the instrument's frame, m,
    NaN where unmeasured. rotation: (N, 3) rotation vectors, rad, or all NaN. distances: name -> (N,) m.
    readings: columns (N,) of READINGS. described: what files say of cameras, boards and surfaces, by "cameras", "board"
    and "surfaces". observations: what was read besides points, poses and distances.
    labels: column -> (N,) text ("" where the column is absent or empty). payload: (N,) kg. extras: name -> (N,)
    in `extra_units`. row: (N,) data row in the file, counted from 1. sha256: of the file's bytes.
    columns: the joints' names in the table, where they differ from the mechanism's. extra_names: the extra columns'.
    ignored: columns of the file that hold text and are none of the labels. empty_rows: rows of it left out.
    joints_approximate: some joint has no sensor, so that equal joint values need not be one pose.
    kinds: of the joints, "revolute" where none are given.
    in_order: the rows are stated to be in the order of measurement, so that a pose may depend on those before it.
    instrument: what its maker states of the instrument that measured, None unless stated.
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

    def __post_init__(self) -> None:
        for name in ("q", "position", "rotation", "row", "payload"):
            getattr(self, name).setflags(write=False)
        for name in ("distances", "readings", "described", "labels", "extras", "extra_units", "extra_names"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, rows: slice) -> "Dataset":
        """Some of the rows: `table[:10]`. Raises InputError for what is no slice."""
        if not isinstance(rows, slice):
            raise InputError(
                f"table[{rows!r}], expected a slice, as in table[:10]; columns are those of to_dataframe()"
            )
        return self.subset(np.arange(len(self))[rows])

    def __repr__(self) -> str:
        """One line."""
        names = ", ".join(self.columns or self.joints)
        measured = int(np.isfinite(self.position).all(axis=1).sum())
        return f"<table {self.source}: {len(self)} poses of {names}, {measured} with x, y, z>"

    def to_dataframe(self) -> pd.DataFrame:
        """Numbers with units in the headers: row, joints [deg] or [mm], every further column under its own name,
        payload, labels, and what was measured [mm], [deg] and [px]."""
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
        """Text labels (N,) of group, repeat, setup or tool."""
        return self.labels.get(column, np.full(len(self), "", dtype="<U1"))

    def codes(self, column: str) -> tuple[list[str], IntArray]:
        """Distinct labels in order of first appearance, and each row's index into them."""
        if column not in self.labels:
            return [""][: len(self)], np.zeros(len(self), dtype=np.int64)
        labels = self.label(column)
        names = list(dict.fromkeys(labels.tolist()))
        index = {name: i for i, name in enumerate(names)}
        return names, np.array([index[x] for x in labels.tolist()], dtype=np.int64)

    def subset(self, rows: IntArray | Sequence[int] | NDArray[np.bool_]) -> "Dataset":
        """Return the table with some rows."""
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
"""Relative difference of equal masses: nine written digits."""


def with_payload(dataset: Dataset, payload: float | None) -> Dataset:
    """Return the poses with `payload` (kg) at every row, if one is given.

    Raises InputError where a payload column of the table has another mass.
    """
    if payload is None:
        return dataset
    if dataset.payload_given:
        other = dataset.payload[np.abs(dataset.payload - payload) > SAME_MASS * payload]
        if len(other):
            there = f"the payload column of {dataset.source} has {other[0]:g} kg"
            raise InputError(f"{payload:g} kg, and {there}; expected one of the two", "payload")
        return dataset
    return replace(dataset, payload=np.full(len(dataset), payload))


def unmeasured(joints: Sequence[str], q: Array, payload: Array | None = None) -> Dataset:
    """A table of poses at q (N, n), rad or m, rows counted from 1, with nothing measured. payload: (N,) kg, none."""
    count = len(q)
    missing = np.full((count, 3), np.nan)
    return Dataset(
        tuple(joints), q, missing, missing.copy(), np.arange(1, count + 1),
        np.zeros(count) if payload is None else payload, payload_given=payload is not None,
    )  # fmt: skip
