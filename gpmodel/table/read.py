"""Reading measured tables: CSV or Excel, units in the headers, separators and decimal commas found out."""

import codecs
import csv
import hashlib
import io
import re
import warnings
from pathlib import Path

import numpy as np
import pandas as pd

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Joint, Mechanism
from gpmodel.mechanism.quantities import checked_mass
from gpmodel.table.bundles import check_repeats
from gpmodel.table.dataset import LABELS, Dataset, with_payload
from gpmodel.table.units import factor, identifier, known_unit, split_header

LARGEST = 1e20
"""In whatever unit: nanoseconds since 1970 are smaller, nothing that is measured is larger."""

FARTHEST = 1e5
"""Metres: no instrument measures points of a machine from so far."""

_DIMENSION = {"revolute": "angle", "prismatic": "length"}
_NAMELESS = re.compile(r"^Unnamed: \d+$")
_NUMBER = re.compile(r"^[-+]?\d+,\d+(?:[eE][-+]?\d+)?$")


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


def read_frame(path: Path) -> tuple[pd.DataFrame, str]:
    """The file's cells as text, empty ones missing, decimal points throughout; and the SHA-256 of its bytes.

    Raises InputError: missing, empty, unreadable, or rows that do not fit the header.
    """
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a measured table") from None
    if not raw.strip():
        raise InputError(f"{path.name}: the file is empty; expected a header line and one row per pose")
    digest = hashlib.sha256(raw).hexdigest()
    if path.suffix.lower() in (".xlsx", ".xls"):
        try:
            header = pd.read_excel(io.BytesIO(raw), header=None, nrows=1, dtype=str).iloc[0].dropna()
            frame = pd.read_excel(io.BytesIO(raw), dtype=str, keep_default_na=False, na_values=[""])
        except ImportError:
            raise InputError(f"{path.name}: Excel tables need openpyxl; pip install 'gpmodel[excel]'") from None
        except Exception as error:  # zip, xml and openpyxl errors of many kinds
            raise InputError(f"{path.name}: is no readable Excel table ({error})") from None
        _check_names(header.tolist(), path)
    else:
        frame = _read_text(raw, path)
    rows = len(frame)
    frame = frame.dropna(how="all").dropna(axis="columns", how="all")
    frame.attrs["empty_rows"] = rows - len(frame)
    if frame.empty:
        raise InputError(f"{path.name}: no rows below the header; expected one row per pose")
    return frame.reset_index(drop=True), digest


def _read_text(raw: bytes, path: Path) -> pd.DataFrame:
    encodings = ("utf-16",) if raw[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE) else ("utf-8-sig", "latin-1")
    for encoding in encodings:
        try:
            text = raw.decode(encoding)
            break
        except UnicodeDecodeError:
            continue
    else:
        raise InputError(f"{path.name}: is no text; expected a table in UTF-8")
    if "\0" in text:
        raise InputError(f"{path.name}: is no text; expected a table in UTF-8")
    header = text.lstrip().splitlines()[0]
    counts = {s: header.count(s) for s in (";", "\t", ",")}
    separator = max(counts, key=lambda s: counts[s])
    _check_names(next(csv.reader([header], delimiter=separator, skipinitialspace=True)), path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(
                io.StringIO(text.lstrip()), sep=separator, dtype=str, skipinitialspace=True, index_col=False,
                keep_default_na=False, na_values=[""],
            )  # fmt: skip
    except pd.errors.ParserWarning:
        raise InputError(
            f"{path.name}: rows have more cells than the header; expected one cell a column "
            f"(with decimal commas, separate columns by ';')"
        ) from None
    except (pd.errors.ParserError, csv.Error) as error:
        raise InputError(f"{path.name}: rows and header do not agree ({str(error).strip()})") from None
    if separator != ",":
        frame = frame.map(lambda x: x.replace(",", ".") if isinstance(x, str) and _NUMBER.match(x.strip()) else x)
    return frame


def _check_names(header: list[str], path: Path) -> None:
    """Raises InputError naming a header that appears twice, which pandas would rename."""
    written = [name.strip() for name in header if name.strip()]
    for name in written:
        if written.count(name) > 1:
            raise InputError(f"{path.name}: column '{name}' appears twice; expected each name once")


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


def numbers(column: pd.Series, where: str) -> Array:
    """The cells of a column as numbers (N,), NaN where empty. Raises InputError naming `where` for anything else."""
    text = column.astype("string").str.strip()
    text = text.mask(text == "")
    values = pd.to_numeric(text, errors="coerce")
    bad = values.isna() & text.notna()
    if bad.any():
        row = int(np.flatnonzero(bad.to_numpy())[0])
        raise InputError(f"{where}, row {row + 1}: '{text.iloc[row]}' is no number; expected a number or an empty cell")
    out: Array = np.asarray(values.astype("float64").to_numpy(dtype=float, na_value=np.nan), dtype=np.float64)
    if np.isinf(out).any():
        raise InputError(f"{where}, row {int(np.flatnonzero(np.isinf(out))[0]) + 1}: infinite; expected a number")
    if np.nanmax(np.abs(out), initial=0.0) > LARGEST:
        row = int(np.nanargmax(np.abs(out)))
        raise InputError(f"{where}, row {row + 1}: {out[row]:g} is no measured value; expected at most {LARGEST:g}")
    return out


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
