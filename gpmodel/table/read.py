"""Read measured tables: CSV or Excel with units in the headers; separators and decimal commas are recognised."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.characters import UNBROKEN, steers
from gpmodel.errors import InputError, LayoutError, choices
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Joint, Mechanism, checked_mass, followers
from gpmodel.table.blocks import check_repeats
from gpmodel.table.cells import clock_seconds, numbers, units_in_headers
from gpmodel.table.convention import COLUMN, convention_in, described_axes, read_convention, with_joint_columns
from gpmodel.table.dataset import LABELS, READINGS, TOUCHED, Dataset
from gpmodel.table.units import factor, identifier, known_unit, one_spelling, split_header

FARTHEST = 1e5
"""Largest coordinate of a measured point, m."""

ABSOLUTE_ZERO = {"degC": -273.15, "degF": -459.67, "K": 0.0}
"""Absolute zero of temperature in each unit of temperature."""

_DIMENSION = {"revolute": "angle", "prismatic": "length"}
_DIMENSIONS = {**dict.fromkeys("xyz", "length"), **dict.fromkeys(("rx", "ry", "rz"), "angle"), "payload": "mass"}
"""Physical dimension of table columns with reserved names, such as x or payload."""
_EXAMPLES = {"length": "mm", "angle": "deg", "mass": "kg"}
_TORQUE = re.compile(r"^(torque|tau|effort)_")
_PARENTHESES = re.compile(r"^(?P<name>.*?)\s*\(\s*(?P<unit>[^\W\d_][^()]*?|°.*?|%)\s*\)$")
_NAMELESS = re.compile(r"^Unnamed: \d+$")


def dataset_from(
    frame: pd.DataFrame, path: Path, mechanism: Mechanism, *, need_measurement: bool = True, sha256: str = ""
) -> Dataset:
    """Convert the text cells of a table to a Dataset. path: file name for messages.

    The page docs/reference/formats.md describes the columns. Raises InputError for a missing or unknown unit, missing
    or surplus joints, text among numbers, or no measurements.
    """
    frame = units_in_headers(frame, path)
    said = convention_in(frame)
    columns = _split_columns(with_joint_columns(frame, path, mechanism, ""), path)
    empty = [split_header(name)[0] for name in frame.attrs.get("empty_columns", ())]
    named = _joint_columns(columns, mechanism.joints, path, empty)
    n = len(frame)
    cells = _Cells(np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.zeros(n))
    following = followers(mechanism)
    _check_headers({n: c for n, c in columns.items() if identifier(n) not in following}, named, path)
    joints = {
        name: _joint_values(columns[name], joint, f"{path.name}, column '{name}'") for name, joint in named.items()
    }
    convention = read_convention(said, mechanism, f"{path.name}, column '{COLUMN}'") if said else None
    left = described_axes(columns, said) | {name for name in columns if identifier(name) in following}
    cells.ignored += [name for name in columns if name in left]
    for name, (unit, column) in columns.items():
        if name not in named and name not in left and not (said and name == COLUMN):
            cells.take(name, unit, column, f"{path.name}, column '{name}'")
    q = np.column_stack([_complete(values, f"{path.name}, column '{joint}'") for joint, values in joints.items()])
    _check_measurement(path, cells, need_measurement)
    _check_near(path, cells)
    tools = {"tool": cells.labels["tip"]} if branched(mechanism) and "tip" in cells.labels else {}
    dataset = Dataset(
        joints=tuple(j.name for j in mechanism.joints),
        kinds=tuple(j.kind for j in mechanism.joints),
        q=q,
        row=np.arange(1, n + 1),
        source=path.name,
        sha256=sha256,
        columns=tuple(joints),
        empty_rows=int(frame.attrs.get("empty_rows", 0)),
        joints_approximate=not all(j.measured for j in mechanism.joints),
        convention="" if convention is None else convention.text,
        **vars(cells) | {"labels": tools | cells.labels, "ignored": tuple(cells.ignored)},
    )
    check_repeats(dataset)
    return dataset


@dataclass
class _Cells:
    """Values of a table's columns other than joints, in SI units; `extras` are in the units of the table."""

    position: Array
    rotation: Array
    payload: Array
    payload_given: bool = False
    distances: dict[str, Array] = field(default_factory=dict)
    readings: dict[str, Array] = field(default_factory=dict)
    labels: dict[str, NDArray[np.str_]] = field(default_factory=dict)
    extras: dict[str, Array] = field(default_factory=dict)
    extra_units: dict[str, str] = field(default_factory=dict)
    extra_names: dict[str, str] = field(default_factory=dict)
    ignored: list[str] = field(default_factory=list)

    def take(self, name: str, unit: str | None, column: pd.Series, where: str) -> None:
        """Store the values of a table column by its name: label, position, rotation, distance, payload, input, ..."""
        if name in LABELS:
            self.labels[name] = _labels(column, where)
        elif name in ("x", "y", "z"):
            self.position[:, "xyz".index(name)] = numbers(column, where) * factor(unit or "1", "length", where)
        elif name in ("rx", "ry", "rz"):
            self.rotation[:, "xyz".index(name[1])] = numbers(column, where) * factor(unit or "1", "angle", where)
        elif name.startswith("distance_"):
            self.distances[name] = _not_negative(numbers(column, where) * factor(unit or "1", "length", where), where)
        elif name in READINGS and (READINGS[name] != "px" or unit in (None, "px", "pixel", "pixels")):
            dimension = {"m": "length", "rad": "angle"}.get(READINGS[name])
            self.readings[name] = numbers(column, where) * (factor(unit or "1", dimension, where) if dimension else 1.0)
        elif name == "payload":
            self.payload = _complete(numbers(column, where) * factor(unit or "1", "mass", where), where)
            self.payload_given = True
            for row, mass in enumerate(self.payload.tolist(), 1):
                checked_mass(mass, f"{where}, row {row}")
        elif unit is None and (seconds := clock_seconds(column)) is not None:
            self._take_extra(name, "s", np.asarray(seconds, dtype=float), where)
        elif unit is None:
            self.ignored.append(name)
        elif known_unit(unit):
            self._take_extra(name, unit, numbers(column, where), where)
        elif _TORQUE.match(name):
            raise InputError(f"{where}: '[{unit}]' is no known unit; write for example [N*m]")
        else:
            self.ignored.append(f"{name} [{unit}]")

    def _take_extra(self, name: str, unit: str, values: Array, where: str) -> None:
        word, unit = identifier(name), one_spelling(unit)
        _check_temperature(values, unit, where)
        self.extras[word], self.extra_units[word] = _complete(values, where), unit
        self.extra_names[word] = name


def _labels(column: pd.Series, where: str) -> NDArray[np.str_]:
    """Return the text of each row of a label column, with single blanks between words.
    Raises InputError naming the row of a label with control characters, double quotes or backslashes."""
    words = [" ".join(word.split()) for word in column.fillna("").astype(str)]
    if bad := next((row for row, word in enumerate(words, 1) if steers(word)), 0):
        raise InputError(f"{where}, row {bad}: control characters in a label; expected plain text")
    if bad := next((row for row, word in enumerate(words, 1) if not re.match(UNBROKEN, word)), 0):
        raise InputError(f"{where}, row {bad}: label {words[bad - 1]!r}; expected no double quotes and no backslashes")
    return np.array(words, dtype=str)


def _not_negative(values: Array, where: str) -> Array:
    """Return measured distances, m. Raises InputError naming the row of a negative distance."""
    if (values < 0).any():
        row = int(np.flatnonzero(values < 0)[0])
        raise InputError(f"{where}, row {row + 1}: {1e3 * values[row]:g} mm; expected a distance of zero or more")
    return values


def _check_temperature(values: Array, unit: str, where: str) -> None:
    """Raise InputError naming the row of a temperature below absolute zero."""
    least = ABSOLUTE_ZERO.get(unit, -np.inf)
    if (values < least).any():
        row = int(np.flatnonzero(values < least)[0])
        raise InputError(f"{where}, row {row + 1}: {values[row]:g} {unit} is below absolute zero, {least:g} {unit}")


def _check_near(path: Path, cells: _Cells) -> None:
    """Raise InputError if a measured point or distance is farther than any instrument can measure."""
    for what, values in (("x, y, z", cells.position), *((n, v[:, None]) for n, v in cells.distances.items())):
        if (far := np.nanmax(np.abs(values), initial=0.0, axis=1)).max() > FARTHEST:
            raise InputError(
                f"{path.name}, {what}, row {int(np.argmax(far)) + 1}: {far.max():.3g} m from the instrument; "
                f"expected at most {FARTHEST:g} m"
            )


def _split_columns(frame: pd.DataFrame, path: Path) -> dict[str, tuple[str | None, pd.Series]]:
    columns: dict[str, tuple[str | None, pd.Series]] = {}
    for i, header in enumerate(frame.columns):
        name, unit = split_header(" ".join(str(header).split()))
        if steers(name):
            raise InputError(f"{path.name}: column {i + 1} has control characters in its name; expected plain text")
        if not name or _NAMELESS.match(name):
            raise LayoutError(f"{path.name}: column {i + 1} has no name; expected a name and its unit in every header")
        if name in columns:
            raise LayoutError(f"{path.name}: column '{name}' appears twice; expected each name once")
        columns[name] = (unit, frame.iloc[:, i])
    _check_brackets(columns, path)
    return columns


def _check_brackets(columns: dict[str, tuple[str | None, pd.Series]], path: Path) -> None:
    """Raise LayoutError naming all columns of numbers whose unit is in parentheses."""
    found = {name: _PARENTHESES.match(name) for name, (unit, cells) in columns.items() if unit is None}
    wrong = [m for n, m in found.items() if m and known_unit(m["unit"]) and _has_numbers(columns[n][1])]
    if wrong:
        names = ", ".join(f"'{m[0]}'" for m in wrong)
        raise LayoutError(f"{path.name}: unit in parentheses: {names}; write '{wrong[0]['name']} [{wrong[0]['unit']}]'")


def _joint_columns(
    columns: dict[str, tuple[str | None, pd.Series]], joints: tuple[Joint, ...], path: Path, empty: list[str]
) -> dict[str, Joint]:
    """Assign table columns to joints. Raises InputError for missing or surplus joints, or names that differ from a
    joint's name in capitals."""
    written = {identifier(column): column for column in columns}
    by_name = {written.get(j.name, j.name): j for j in joints}
    by_number = {f"J{i}": j for i, j in enumerate(joints, 1)}
    named = len(set(by_name) & set(columns))
    numbered = named < len(by_name) and named <= len(set(by_number) & set(columns))
    expected = by_number if numbered else by_name
    small = {name.casefold(): name for name in expected}
    known = {*expected, *_DIMENSIONS}
    if wrong := [column for column in columns if column not in known and column.casefold() in small]:
        meant = ", ".join(f"'{small[column.casefold()]}'" for column in wrong)
        raise LayoutError(f"{path.name}: {_columns(wrong)}: not a joint; expected {meant}, in this spelling")
    missing = [name for name in expected if name not in columns]
    if missing and missing[0] in empty:
        raise InputError(f"{path.name}, column '{missing[0]}': empty in every row; expected a number in every row")
    if missing:
        units = "[mm] or [m]" if expected[missing[0]].kind == "prismatic" else "[deg] or [rad]"
        by_names = choices(expected[missing[0]].name, by_name)
        ways = " or ".join(dict.fromkeys((choices(missing[0], by_number), by_names)))
        raise LayoutError(
            f"{path.name}: joint column '{missing[0]}' is missing; expected {ways}, this one with {units}"
        )
    surplus = [c for c in columns if re.fullmatch(r"J\d+", c) and c not in by_number and c not in by_name]
    if surplus:
        raise InputError(
            f"{path.name}: joint column '{surplus[0]}' is one too many; expected {choices(surplus[0], by_number)}"
        )
    return expected


def _joint_values(column: tuple[str | None, pd.Series], joint: Joint, where: str) -> Array:
    """Return the values of a joint at all rows of a table, rad or m."""
    unit, cells = column
    return numbers(cells, where) * factor(unit or "1", _DIMENSION[joint.kind], where)


def _check_headers(columns: dict[str, tuple[str | None, pd.Series]], joints: dict[str, Joint], path: Path) -> None:
    """Raise LayoutError naming columns with capitals in a reserved name, and columns of numbers without a unit."""
    capitals, bare, own = [], {}, {*_DIMENSIONS, *LABELS}
    for name, (unit, cells) in columns.items():
        if name not in own | joints.keys() and name.lower() in own:
            capitals.append(name)
        elif unit is None and (example := _example(name, cells, joints)):
            bare[name] = f"'{name} [{example}]'"
    said = []
    if capitals:
        small = ", ".join(f"'{name.lower()}'" for name in capitals)
        said.append(f"{_columns(capitals)}: reserved names in lower case; expected {small}, or another name")
    if bare:
        pure = ", or [1] for a pure number" if any(text.endswith("[unit]'") for text in bare.values()) else ""
        said.append(f"{_columns(list(bare))}: no unit; write {', '.join(bare.values())}{pure}")
    if said:
        raise LayoutError(f"{path.name}, {'; '.join(said)}")


def _columns(names: list[str]) -> str:
    return f"column{'s' if len(names) > 1 else ''} {', '.join(map(repr, names))}"


def _example(name: str, cells: pd.Series, joints: dict[str, Joint]) -> str:
    """Return an example unit for a column without a unit: "unit" for an input, "" if no unit is needed."""
    if name in LABELS:
        return ""
    if name in READINGS:
        return {"m": "mm", "rad": "deg"}.get(READINGS[name], "")
    dimension = _DIMENSION[joints[name].kind] if name in joints else _DIMENSIONS.get(name, "")
    if name.startswith("distance_"):
        dimension = "length"
    return _EXAMPLES[dimension] if dimension else "unit" * _has_numbers(cells)


def _has_numbers(column: pd.Series) -> bool:
    return bool(pd.to_numeric(column, errors="coerce").notna().any())


def _complete(values: Array, where: str) -> Array:
    if np.isnan(values).any():
        row = int(np.flatnonzero(np.isnan(values))[0]) + 1
        raise InputError(f"{where}, row {row}: empty or NaN; expected a number in every row")
    return values


def _check_measurement(path: Path, cells: _Cells, need: bool) -> None:
    position, rotation = cells.position, cells.rotation
    numbers = (position, rotation, *cells.distances.values(), *cells.readings.values())
    measured = any(bool(np.isfinite(values).any()) for values in numbers)
    measured = measured or any((cells.labels[name] != "").any() for name in TOUCHED if name in cells.labels)
    if need and not measured:
        raise InputError(f"{path.name}: nothing measured; expected columns 'x [mm],y [mm],z [mm]' or 'distance_A [mm]'")
    partial = np.isfinite(rotation).any(axis=1) & ~np.isfinite(rotation).all(axis=1)
    if partial.any():
        row = int(np.flatnonzero(partial)[0]) + 1
        raise InputError(f"{path.name}, row {row}: rotation is incomplete; expected rx, ry and rz, or none")
