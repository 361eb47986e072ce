"""Measured files of other programs: a small map of columns turns one into a table this program reads."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.formula.expression import Expression
from gpmodel.table.cells import LARGEST, numbers, read_frame
from gpmodel.table.dataset import LABELS
from gpmodel.table.imported import cells, left_out, rotation_vectors
from gpmodel.table.units import factor, known_unit, split_header
from gpmodel.texts import read_toml

EXAMPLE = 'x = "tracker_x [mm]" or x = "target_x - error_x [mm]"'
FAR_FROM_ONE = 0.05
"""Of the norm of a quaternion: written with two digits each, they are nearer."""
_EULER = re.compile(r"^(intrinsic|fixed) ([XYZ])(?!\2)([XYZ])(?!\3)([XYZ])$")


@dataclass(frozen=True)
class OrientationColumns:
    """How a file writes orientations: columns (or formulas) with units, and their convention.

    convention: `intrinsic XYZ` means R = Rx(a) Ry(b) Rz(c), `fixed XYZ` R = Rz(c) Ry(b) Rx(a), any axes likewise;
    `rotation vector`; `quaternion xyzw` or `quaternion wxyz`, whose columns have no unit.
    """

    columns: tuple[str, ...]
    convention: str


@dataclass(frozen=True)
class ColumnMap:
    """columns: name in the table -> column of the file, or formula of its columns, with its unit in brackets."""

    columns: Mapping[str, str]
    orientation: OrientationColumns | None = None
    source: str = "map"


def read_map(path: Path) -> ColumnMap:
    """The map in a TOML file: a table [columns] and, for full poses, [orientation].

    Raises InputError where it is missing, no TOML, or has other keys.
    """
    content = read_toml(path, "a map of columns")
    columns, orientation = content.pop("columns", None), content.pop("orientation", None)
    if content:
        raise InputError(f"{path.name}: '{next(iter(content))}' is unknown; expected [columns] and [orientation]")
    if not isinstance(columns, dict) or not columns or not all(isinstance(v, str) for v in columns.values()):
        raise InputError(f"{path.name}: expected a table [columns] with lines such as {EXAMPLE}")
    if orientation is not None and any(name in columns for name in ("rx", "ry", "rz")):
        raise InputError(f"{path.name}: rx, ry, rz and [orientation] are both given; expected one of the two")
    return ColumnMap(columns, None if orientation is None else _orientation(orientation, path.name), path.name)


def _orientation(content: object, where: str) -> OrientationColumns:
    if not isinstance(content, dict) or set(content) != {"columns", "convention"}:
        raise InputError(f'{where}: [orientation]: expected `columns = [...]` and `convention = "intrinsic XYZ"`')
    convention, columns = content["convention"], content["columns"]
    _, expected = _reader(convention, f"{where}: [orientation]")
    if not isinstance(columns, list) or len(columns) != expected or not all(isinstance(c, str) for c in columns):
        raise InputError(f"{where}: [orientation]: columns: expected {expected} texts for '{convention}'")
    return OrientationColumns(tuple(columns), convention)


def _reader(convention: object, where: str) -> tuple[Callable[[Array], Rotation], int]:
    """What turns rows of numbers (radians) into rotations, and how many numbers it needs."""
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


def import_file(path: Path, columns: ColumnMap) -> pd.DataFrame:
    """The file's rows as a table with units in its headers, text cells; orientations as rotation vectors [deg].

    Separator and decimal comma are found out. Columns the map does not name are left out. Raises InputError for a
    column that is not there, a formula that cannot be read, a missing or unknown unit, text among numbers.
    """
    frame, _ = read_frame(path)
    frame.columns = frame.columns.astype(str).str.strip()
    out: dict[str, pd.Series | list[str]] = {}
    for name, text in columns.columns.items():
        where = f"{columns.source}: {name}"
        if name in LABELS:
            out[name] = _column(frame, text.strip(), path, where).fillna("").str.strip()
            continue
        values, unit = _values(frame, text, path, where)
        if unit is None or not known_unit(unit):
            problem = "no unit" if unit is None else f"'[{unit}]' is no known unit"
            raise InputError(f"{where}: {problem}; write for example {EXAMPLE}")
        out[f"{name} [{unit}]"] = cells(values)
    if columns.orientation is not None:
        vectors = _rotation_vectors(frame, columns.orientation, path, f"{columns.source}: [orientation]")
        out |= {f"r{axis} [deg]": cells(np.degrees(v)) for axis, v in zip("xyz", vectors.T, strict=True)}
    return pd.DataFrame(out)


def unread(path: Path, columns: ColumnMap) -> tuple[str, ...]:
    """Say which columns of a file a map does not name."""
    frame, _ = read_frame(path)
    frame.columns = frame.columns.astype(str).str.strip()
    oriented = () if columns.orientation is None else columns.orientation.columns
    read = {name for text in (*columns.columns.values(), *oriented) for name in _names(frame, text)}
    return left_out(f"not in {columns.source}", (str(name) for name in frame if name not in read))


def _names(frame: pd.DataFrame, text: str) -> tuple[str, ...]:
    """The columns that a line of a map reads: one by its name, or those of a formula."""
    name = split_header(text.strip())[0]
    return (name,) if name in frame.columns else Expression(name).inputs


def _rotation_vectors(frame: pd.DataFrame, orientation: OrientationColumns, path: Path, where: str) -> Array:
    """Rotation vectors (N, 3), rad; NaN where any of the numbers is missing."""
    reader, count = _reader(orientation.convention, where)
    parts = []
    for text in orientation.columns:
        values, unit = _values(frame, text, path, where)
        if count == 3 and unit is None:
            raise InputError(f"{where}: '{text}' has no unit; write '{text} [deg]'")
        parts.append(values if count == 4 else values * factor(unit or "1", "angle", where))
    rows = np.column_stack(parts)
    norms = np.linalg.norm(rows, axis=1)
    if count == 4 and (wrong := np.flatnonzero(np.abs(norms - 1.0) > FAR_FROM_ONE)).size:
        raise InputError(f"{where}: row {wrong[0] + 1}: quaternion of norm {norms[wrong[0]]:g}, expected 1")
    return rotation_vectors(reader, rows)


def _values(frame: pd.DataFrame, text: str, path: Path, where: str) -> tuple[Array, str | None]:
    """Numbers (N,) of a column or a formula of columns, and the unit written behind it."""
    name, unit = split_header(text)
    if name in frame.columns:
        return numbers(frame[name], f"{path.name}, column '{name}'"), unit
    try:
        formula = Expression(name)
    except InputError:
        formula = None
    if formula is None or formula.inputs in ((), (name,)):
        _column(frame, name, path, where)
    assert formula is not None
    parts = {i: numbers(_column(frame, i, path, where), f"{path.name}, column '{i}'") for i in formula.inputs}
    values = np.array(formula(pd.DataFrame(parts).to_records()))
    given = np.isfinite(np.column_stack([*parts.values()])).all(axis=1)
    if (wrong := np.flatnonzero(given & ~(np.abs(values) <= LARGEST))).size:
        raise InputError(f"{where}: '{name}' is {values[wrong[0]]:g} in row {wrong[0] + 1}, expected a measured value")
    return values, unit


def _column(frame: pd.DataFrame, name: str, path: Path, where: str) -> pd.Series:
    if name not in frame.columns:
        raise InputError(f"{where}: {path.name} has no column '{name}'; it has {choices(name, frame.columns)}")
    return frame[name]
