"""Import of measured data from other programs: a map of columns converts a file to a table for gpmodel."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.cell_units import spelled_unit
from gpmodel.table.cells import LARGEST, numbers
from gpmodel.table.convention import COLUMN, convention_text, sum_of
from gpmodel.table.dataset import LABELS, READINGS
from gpmodel.table.layout import Sheet, name_and_unit
from gpmodel.table.units import JOINT_UNITS, factor, factor_like, identifier, known_unit, split_header
from gpmodel.texts import read_toml


@dataclass(frozen=True)
class Imported:
    """The result of importing a file of another program.

    content: a table of text cells, the text of a mechanism's file, or the content of a TOML file of cameras.
    described: content of TOML files of cameras and of boards, by "cameras" and "board".
    left_out: parts of the file that were not imported, each with the reason.
    """

    content: pd.DataFrame | str | dict[str, object]
    described: Mapping[str, Mapping[str, object]] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


def left_out(what: str, names: Iterable[str]) -> tuple[str, ...]:
    """List parts of a file that are not imported in one phrase, as "no joint of arm.urdf:
    l6_x"; empty without names."""
    named = ", ".join(names)
    return (f"{what}: {named}",) if named else ()


def joint_cells(mechanism: Mechanism | None, values: Mapping[str, Array], where: str) -> dict[str, list[str]]:
    """Return table columns of joint values with units, from values by joint name, rad and m.

    Raises InputError if a joint or the mechanism is missing; the mechanism defines which joints are prismatic.
    """
    if mechanism is None:
        raise InputError(f"{where}: joint values without units; expected --mechanism M, whose joints turn or slide")
    if missing := [j.name for j in mechanism.joints if j.name not in values]:
        raise InputError(f"{where}: no values of joint '{missing[0]}'; it has {choices(missing[0], values)}")
    return {f"{j.name} [{JOINT_UNITS[j.kind]}]": cells(values[j.name]) for j in mechanism.joints}


def surplus_joints(mechanism: Mechanism | None, names: Iterable[str]) -> tuple[str, ...]:
    """List names that are not joints of the mechanism; columns with these names are not imported."""
    if mechanism is None:
        return ()
    joints = {joint.name for joint in mechanism.joints}
    return left_out(f"no joint of {mechanism.name}", (name for name in names if name not in joints))


def cells(values: Array) -> list[str]:
    """Write numbers as text cells of a table, "" for NaN."""
    return ["" if np.isnan(v) else repr(float(v)) for v in values]


def rotation_vectors(read: Callable[[Array], Rotation], numbers: Array) -> Array:
    """Convert rows of Euler angles or quaternions to rotation vectors, rad; NaN for a row with a missing number."""
    out, known = np.full((len(numbers), 3), np.nan), np.isfinite(numbers).all(axis=1)
    if known.any():
        out[known] = read(numbers[known]).as_rotvec()
    return out


RESERVED = {*"xyz", "rx", "ry", "rz", "payload", *READINGS, *LABELS}
"""Names of table columns that are no joints and no inputs."""
EXAMPLE = 'x = "tracker_x [mm]" or x = "target_x - error_x [mm]"'
FAR_FROM_ONE = 0.05
"""Largest deviation of a quaternion's norm from one. Quaternions rounded to two digits have a norm closer to one."""
_EULER = re.compile(r"^(intrinsic|fixed) ([XYZ])(?!\2)([XYZ])(?!\3)([XYZ])$")
_NUMBERED = re.compile(r"^c?(\d+)$")


@dataclass(frozen=True)
class OrientationColumns:
    """Orientation columns of a file of another program.

    columns: columns of the angles or quaternion, or formulas of columns, with units.
    convention: `intrinsic XYZ` is R = Rx(a) Ry(b) Rz(c), `fixed XYZ` is R = Rz(c) Ry(b) Rx(a), and other axes likewise;
    `rotation vector`; `quaternion xyzw` or `quaternion wxyz`, whose columns have no unit.
    """

    columns: tuple[str, ...]
    convention: str


@dataclass(frozen=True)
class ColumnMap:
    """Map from the columns of a file to the columns of a table.

    columns: name in the table -> column of the file, or a formula of columns, with its unit in brackets. A column of
    the file is given by its name or by its number, as c7.
    tools: columns of x, y and z of several reflectors, by reflector.
    header: True if the file has a header line.
    join: rule by which a second file is joined, see `gpmodel.table.join`.
    """

    columns: Mapping[str, str]
    orientation: OrientationColumns | None = None
    source: str = "map"
    tools: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    header: bool = True
    join: str = ""

    def content(self) -> dict[str, object]:
        """Return the map (quantity and unit of each column of a foreign table) as the content of a TOML file."""
        out: dict[str, object] = ({} if self.header else {"header": False}) | ({"join": self.join} if self.join else {})
        out["columns"] = dict(self.columns)
        if self.tools:
            out["tool"] = {name: dict(point) for name, point in self.tools.items()}
        if self.orientation is not None:
            out["orientation"] = {
                "columns": list(self.orientation.columns), "convention": self.orientation.convention
            }  # fmt: skip
        return out


def read_map(path: Path) -> ColumnMap:
    """Read a map from a TOML file: a table [columns] and, for orientations, [orientation].
    Raises InputError if the file is missing, not TOML, or has unknown keys."""
    content = read_toml(path, "a map of columns")
    columns, orientation = content.pop("columns", None), content.pop("orientation", None)
    header, join, tools = content.pop("header", True), content.pop("join", ""), content.pop("tool", {})
    if content:
        known = "[columns], [tool.NAME], [orientation], header and join"
        raise InputError(f"{path.name}: '{next(iter(content))}' is unknown; expected {known}")
    if not isinstance(header, bool) or not isinstance(join, str):
        raise InputError(f'{path.name}: expected header = false, and join = "order" or a column\'s name')
    if not isinstance(columns, dict) or not columns or not all(isinstance(v, str) for v in columns.values()):
        raise InputError(f"{path.name}: expected a table [columns] with lines such as {EXAMPLE}")
    points = tools.values() if isinstance(tools, dict) else [None]
    if not all(
        isinstance(p, dict) and set(p) == set("xyz") and all(isinstance(v, str) for v in p.values()) for p in points
    ):
        raise InputError(f"{path.name}: [tool.NAME]: expected x, y and z, lines such as {EXAMPLE}")
    if orientation is not None and any(name in columns for name in ("rx", "ry", "rz")):
        raise InputError(f"{path.name}: rx, ry, rz and [orientation] are both given; expected one of the two")
    oriented = None if orientation is None else _orientation(orientation, path.name)
    return ColumnMap(columns, oriented, path.name, tools, header, join)


def _orientation(content: object, where: str) -> OrientationColumns:
    if not isinstance(content, dict) or set(content) != {"columns", "convention"}:
        raise InputError(f'{where}: [orientation]: expected `columns = [...]` and `convention = "intrinsic XYZ"`')
    convention, columns = content["convention"], content["columns"]
    _, expected = orientation_reader(convention, f"{where}: [orientation]")
    if not isinstance(columns, list) or len(columns) != expected or not all(isinstance(c, str) for c in columns):
        raise InputError(f"{where}: [orientation]: columns: expected {expected} texts for '{convention}'")
    return OrientationColumns(tuple(columns), convention)


def orientation_reader(convention: object, where: str) -> tuple[Callable[[Array], Rotation], int]:
    """Return the conversion of rows of numbers (radians) to rotations, and the number of columns that it needs."""
    if convention == "rotation vector":
        return Rotation.from_rotvec, 3
    if convention == "quaternion xyzw":
        return Rotation.from_quat, 4
    if convention == "quaternion wxyz":
        return partial(Rotation.from_quat, scalar_first=True), 4
    euler = _EULER.match(convention) if isinstance(convention, str) else None
    if euler is None:
        raise InputError(
            f"{where}: convention '{convention}' is unknown; expected 'intrinsic XYZ', 'fixed ZYX' or other axes, "
            "'rotation vector', 'quaternion xyzw' or 'quaternion wxyz'"
        )
    axes = "".join(euler.groups()[1:])
    return partial(Rotation.from_euler, axes if euler[1] == "intrinsic" else axes.lower()), 3


def import_file(sheet: Sheet, columns: ColumnMap) -> pd.DataFrame:
    """Convert the rows of a sheet to a table of text cells with units in its headers.

    Orientations become rotation vectors [deg]. Columns that the map does not name are not imported. Three equal
    coordinates x, y, z count as missing, because some programs write them if no reflector was seen. With several
    reflectors the table has one row per pose and reflector. Raises InputError for a missing column, an invalid formula,
    a missing or unknown unit, or text among numbers.
    """
    out = _mapped(sheet, columns.columns, columns.source)
    if columns.orientation is not None:
        vectors = _rotation_vectors(sheet, columns.orientation, f"{columns.source}: [orientation]")
        out |= {f"r{axis} [deg]": cells(np.degrees(v)) for axis, v in zip("xyz", vectors.T, strict=True)}
    if said := joint_convention(sheet, columns):
        out[COLUMN] = [said] * len(sheet.cells)
    if not columns.tools:
        return _without_equal(pd.DataFrame(out))
    poses = {} if "group" in out else {"group": [str(k + 1) for k in range(len(sheet.cells))]}
    parts = [
        _without_equal(pd.DataFrame(out | _mapped(sheet, point, f"{columns.source}: [tool.{name}]") | poses)).assign(
            tool=name
        )
        for name, point in columns.tools.items()
    ]
    return pd.concat(parts).sort_index(kind="stable").reset_index(drop=True)


def joint_convention(sheet: Sheet, columns: ColumnMap) -> str:
    """Return the convention of a map's joint columns: all angles and lengths that are no measurement, else J1, J2, ...

    Return "" if the joints are no sums of columns with whole factors.
    """
    other = [n for n in columns.columns if n not in RESERVED and not n.startswith("distance_")]
    every = {name: _sum_of(sheet, columns.columns[name]) for name in other}
    sums = {n: found for n, found in every.items() if any(factor_like(found[2], si) for si in JOINT_UNITS.values())}
    numbered = {name: found for name, found in sums.items() if re.fullmatch(r"J\d+", name)}
    return convention_text(sums) or convention_text(numbered)


def _sum_of(sheet: Sheet, text: str) -> tuple[Mapping[str, float], float, str]:
    """Return the factors of the axes in an entry of a map, its constant and unit; no factors unless it is a sum."""
    formula, unit = split_header(text)
    column = find(sheet, formula)
    column = find(sheet, text.strip()) if column is None else column
    unit = unit or name_and_unit(text)[1] or ""
    if column is not None:
        return {_axis(sheet, column): 1.0}, 0.0, unit
    factors, constant = sum_of(formula) or ({}, 0.0)
    places = {axis: find(sheet, axis) for axis in factors}
    return {a if (i := places[a]) is None else _axis(sheet, i): k for a, k in factors.items()}, constant, unit


def _axis(sheet: Sheet, column: int) -> str:
    """Return the name of a controller's axis: the header of its column, c7 without a unique header."""
    name = identifier(name_and_unit(sheet.names[column])[0])
    alike = [header for header in sheet.names if identifier(name_and_unit(header)[0]) == name]
    return name if name.isascii() and name.strip("_") and len(alike) == 1 else f"c{column + 1}"


def _without_equal(table: pd.DataFrame) -> pd.DataFrame:
    """Clear x, y and z in rows with x = y = z, which some programs write for a missing point."""
    point = [name for name in table if split_header(str(name))[0] in ("x", "y", "z")]
    if len(point) == 3:
        same = (table[point[0]] == table[point[1]]) & (table[point[1]] == table[point[2]])
        table.loc[same, point] = ""
    return table


def _mapped(sheet: Sheet, columns: Mapping[str, str], source: str) -> dict[str, pd.Series | list[str]]:
    """Return the cells of each imported column, by the header of the column in the new table."""
    out: dict[str, pd.Series | list[str]] = {}
    for name, text in columns.items():
        where = f"{source}: {name}"
        if name in LABELS:
            out[name] = sheet.cells[column_of(sheet, text.strip(), where)].fillna("").str.strip()
            continue
        values, unit = _values(sheet, text, where)
        if unit is None or not known_unit(unit):
            problem = "no unit" if unit is None else f"'[{unit}]' is no known unit"
            raise InputError(f"{where}: {problem}; write for example {EXAMPLE}")
        out[f"{name} [{unit}]"] = cells(values)
    return out


def unread(sheet: Sheet, columns: ColumnMap) -> tuple[str, ...]:
    """List the columns of a file that its column map does not name."""
    oriented = () if columns.orientation is None else columns.orientation.columns
    points = (text for point in columns.tools.values() for text in point.values())
    read = {i for text in (*columns.columns.values(), *points, *oriented) for i in _read_by(sheet, text)}
    return left_out(f"not in {columns.source}", (n or f"c{i + 1}" for i, n in enumerate(sheet.names) if i not in read))


def _read_by(sheet: Sheet, text: str) -> tuple[int, ...]:
    """Return the file's columns that an entry of a column map uses: one column, or the columns of a formula."""
    for name in (text.strip(), split_header(text)[0]):
        if (found := find(sheet, name)) is not None:
            return (found,)
    return tuple(column_of(sheet, name, "") for name in Expression(split_header(text)[0]).inputs)


def find(sheet: Sheet, name: str) -> int | None:
    """Find a column by its header, its header without the unit, its name in an expression, or its number, c7.
    None is returned if no column or several columns match."""
    for as_named in (str.strip, lambda header: name_and_unit(header)[0], identifier):
        found = [i for i, header in enumerate(sheet.names) if header and as_named(header) == name]
        if found:
            return found[0] if len(found) == 1 else None
    number = _NUMBERED.match(name)
    return int(number[1]) - 1 if number and 0 < int(number[1]) <= len(sheet.names) else None


def _rotation_vectors(sheet: Sheet, orientation: OrientationColumns, where: str) -> Array:
    """Compute rotation vectors, rad, from orientation columns of a file; NaN where a number is missing."""
    reader, count = orientation_reader(orientation.convention, where)
    parts = []
    for text in orientation.columns:
        values, unit = _values(sheet, text, where)
        if count == 3 and unit is None:
            raise InputError(f"{where}: '{text}' has no unit; write '{text} [deg]'")
        parts.append(values if count == 4 else values * factor(unit or "1", "angle", where))
    rows = np.column_stack(parts)
    norms = np.linalg.norm(rows, axis=1)
    if count == 4 and (wrong := np.flatnonzero(np.abs(norms - 1.0) > FAR_FROM_ONE)).size:
        raise InputError(f"{where}: row {wrong[0] + 1}: quaternion of norm {norms[wrong[0]]:g}, expected 1")
    return rotation_vectors(reader, rows)


def _values(sheet: Sheet, text: str, where: str) -> tuple[Array, str | None]:
    """Return the numbers of a column or of a formula of columns, and the unit in brackets after it."""
    name, unit = split_header(text)
    if (column := find(sheet, name)) is not None:
        header = sheet.names[column]
        bare, own, sure = name_and_unit(header)
        if sure and unit is not None and own not in (None, spelled_unit(unit)) and bare == name != header:
            raise InputError(
                f"{where}: '{header}' is in [{own}]; expected [{own}], or '{header} [{unit}]' for a wrong header"
            )
        return _numbers(sheet, column, unit), unit
    if (column := find(sheet, text.strip())) is not None:
        unit = unit or name_and_unit(text)[1]
        return _numbers(sheet, column, unit), unit
    try:
        formula = Expression(name)
    except InputError:
        formula = None
    if formula is None or formula.inputs in ((), (name,)):
        column_of(sheet, name, where)
    assert formula is not None
    parts = {i: _numbers(sheet, column_of(sheet, i, where)) for i in formula.inputs}
    values = np.array(formula(pd.DataFrame(parts).to_records()))
    given = np.isfinite(np.column_stack([*parts.values()])).all(axis=1)
    if (wrong := np.flatnonzero(given & ~(np.abs(values) <= LARGEST))).size:
        raise InputError(f"{where}: '{name}' is {values[wrong[0]]:g} in row {wrong[0] + 1}, expected a measured value")
    return values, unit


def _numbers(sheet: Sheet, column: int, unit: str | None = None) -> Array:
    """Return the numbers of a column; clock times become seconds after the first time."""
    if unit == "s" and (times := sheet.seconds(column)) is not None:
        return np.asarray(times, dtype=np.float64)
    return numbers(sheet.cells[column], f"{sheet.source}, column '{sheet.names[column] or column + 1}'")


def column_of(sheet: Sheet, name: str, where: str) -> int:
    """Return the number of a column, from 0. Raises InputError if no column or several columns have the name."""
    if (found := find(sheet, name)) is None:
        if sheet.names.count(name) > 1:
            numbers = ", ".join(f"c{i + 1}" for i, header in enumerate(sheet.names) if header == name)
            raise InputError(f"{where}: {sheet.source} has several columns '{name}'; expected one of {numbers}")
        known = [header for header in sheet.names if header] or [f"c1 to c{len(sheet.names)}"]
        raise InputError(f"{where}: {sheet.source} has no column '{name}'; it has {choices(name, known)}")
    return found
