"""Reading measured tables: CSV or Excel, units in the headers, separators and decimal commas found out."""

import re
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Joint, Mechanism
from gpmodel.mechanism.quantities import checked_mass
from gpmodel.table.bundles import check_repeats
from gpmodel.table.cells import numbers, read_frame
from gpmodel.table.dataset import LABELS, Dataset, with_payload
from gpmodel.table.units import factor, identifier, known_unit, split_header

FARTHEST = 1e5
"""Metres: no instrument measures points of a machine from so far."""

_DIMENSION = {"revolute": "angle", "prismatic": "length"}
_NAMELESS = re.compile(r"^Unnamed: \d+$")


def read_table(
    path: str | Path, mechanism: Mechanism, payload: float | None = None, *, need_measurement: bool = True
) -> Dataset:
    """Read poses of `mechanism` from a .csv, .txt or .xlsx file; payload: kg carried at every row.

    Columns are described in the README. Raises InputError: file missing or empty, a column without or with an
    unknown unit, joints missing or in surplus, text among numbers, nothing measured.
    """
    path = Path(path)
    frame, digest = read_frame(path)
    dataset = dataset_from(frame, path, mechanism, need_measurement=need_measurement, sha256=digest)
    return with_payload(dataset, payload)


def dataset_from(
    frame: pd.DataFrame, path: Path, mechanism: Mechanism, *, need_measurement: bool = True, sha256: str = ""
) -> Dataset:
    """The poses in a frame of text cells, as read_frame gives it; `path` is what messages name."""
    columns = _split_columns(frame, path)
    joints, used = _joint_columns(columns, mechanism.joints, path)
    n = len(frame)
    position = np.full((n, 3), np.nan)
    rotation = np.full((n, 3), np.nan)
    distances, extras, extra_units, extra_names = {}, {}, {}, {}
    ignored: list[str] = []
    labels: dict[str, np.ndarray] = {}
    payload, payload_given = np.zeros(n), False
    for name, (unit, column) in columns.items():
        if name in used:
            continue
        where = f"{path.name}, column '{name}'"
        if name in LABELS:
            labels[name] = column.fillna("").astype(str).str.strip().to_numpy(dtype=str)
        elif name in ("x", "y", "z"):
            position[:, "xyz".index(name)] = numbers(column, where) * _factor(unit, "length", where)
        elif name in ("rx", "ry", "rz"):
            i = ("rx", "ry", "rz").index(name)
            rotation[:, i] = numbers(column, where) * _factor(unit, "angle", where)
        elif name.startswith("distance_"):
            distances[name] = numbers(column, where) * _factor(unit, "length", where)
        elif name == "payload":
            payload = _complete(numbers(column, where) * _factor(unit, "mass", where), where)
            for row, mass in enumerate(payload.tolist(), 1):
                checked_mass(mass, f"{where}, row {row}")
            payload_given = True
        elif unit is not None or _has_numbers(column):
            values = numbers(column, where)
            if unit is None:
                raise InputError(f"{where}: no unit; write '{name} [unit]', or '{name} [1]' for a pure number")
            if not known_unit(unit):
                raise InputError(f"{where}: '[{unit}]' is no known unit; write for example [degC], [s] or [1]")
            word = identifier(name)
            extras[word], extra_units[word] = _complete(values, where), unit
            extra_names[word] = name
        else:
            ignored.append(name)
    q = np.column_stack([_complete(values, f"{path.name}, column '{joint}'") for joint, values in joints.items()])
    _check_measurement(path, position, rotation, distances, need_measurement)
    for what, values in (("x, y, z", position), *((name, values[:, None]) for name, values in distances.items())):
        if (far := np.nanmax(np.abs(values), initial=0.0, axis=1)).max() > FARTHEST:
            raise InputError(
                f"{path.name}, {what}, row {int(np.argmax(far)) + 1}: {far.max():.3g} m from the instrument; "
                f"expected at most {FARTHEST:g} m"
            )
    dataset = Dataset(
        joints=tuple(j.name for j in mechanism.joints),
        q=q,
        position=position,
        rotation=rotation,
        row=np.arange(1, n + 1),
        payload=payload,
        distances=distances,
        labels=labels,
        extras=extras,
        extra_names=extra_names,
        extra_units=extra_units,
        payload_given=payload_given,
        source=path.name,
        sha256=sha256,
        columns=tuple(joints),
        ignored=tuple(ignored),
        empty_rows=int(frame.attrs.get("empty_rows", 0)),
        joints_approximate=not all(j.measured for j in mechanism.joints),
    )
    check_repeats(dataset)
    return dataset


def _split_columns(frame: pd.DataFrame, path: Path) -> dict[str, tuple[str | None, pd.Series]]:
    columns: dict[str, tuple[str | None, pd.Series]] = {}
    for i, header in enumerate(frame.columns):
        name, unit = split_header(str(header))
        if not name or _NAMELESS.match(name):
            raise InputError(f"{path.name}: column {i + 1} has no name; expected a name and its unit in every header")
        if name in columns:
            raise InputError(f"{path.name}: column '{name}' appears twice; expected each name once")
        columns[name] = (unit, frame.iloc[:, i])
    return columns


def _joint_columns(
    columns: dict[str, tuple[str | None, pd.Series]], joints: tuple[Joint, ...], path: Path
) -> tuple[dict[str, Array], set[str]]:
    written = {identifier(column): column for column in columns}
    by_name = {written.get(j.name, j.name): j for j in joints}
    by_number = {f"J{i}": j for i, j in enumerate(joints, 1)}
    numbered = not set(by_name) <= set(columns)
    expected = by_number if numbered else by_name
    missing = [name for name in expected if name not in columns]
    if missing:
        raise InputError(
            f"{path.name}: joint column '{missing[0]}' is missing; expected {', '.join(by_number)}"
            f" or {', '.join(by_name)}, each with [deg] or [rad]"
        )
    surplus = [c for c in columns if re.fullmatch(r"J\d+", c) and c not in by_number and c not in by_name]
    if surplus:
        raise InputError(f"{path.name}: joint column '{surplus[0]}' is one too many; expected {', '.join(by_number)}")
    values: dict[str, Array] = {}
    for column, joint in expected.items():
        unit, series = columns[column]
        where = f"{path.name}, column '{column}'"
        values[column] = numbers(series, where) * _factor(unit, _DIMENSION[joint.kind], where)
    return values, set(expected)


def _factor(unit: str | None, dimension: str, where: str) -> float:
    if unit is None:
        name = where.split("'")[1]
        example = {"length": "mm", "angle": "deg", "mass": "kg"}[dimension]
        raise InputError(f"{where}: no unit; write '{name} [{example}]'")
    return factor(unit, dimension, where)


def _has_numbers(column: pd.Series) -> bool:
    return bool(pd.to_numeric(column, errors="coerce").notna().any())


def _complete(values: Array, where: str) -> Array:
    if np.isnan(values).any():
        row = int(np.flatnonzero(np.isnan(values))[0]) + 1
        raise InputError(f"{where}, row {row}: empty or NaN; expected a number in every row")
    return values


def _check_measurement(path: Path, position: Array, rotation: Array, distances: dict[str, Array], need: bool) -> None:
    measured = bool(np.isfinite(position).any() or np.isfinite(rotation).any())
    measured = measured or any(bool(np.isfinite(d).any()) for d in distances.values())
    if need and not measured:
        raise InputError(f"{path.name}: nothing measured; expected columns 'x [mm],y [mm],z [mm]' or 'distance_A [mm]'")
    partial = np.isfinite(rotation).any(axis=1) & ~np.isfinite(rotation).all(axis=1)
    if partial.any():
        row = int(np.flatnonzero(partial)[0]) + 1
        raise InputError(f"{path.name}, row {row}: rotation is incomplete; expected rx, ry and rz, or none")
