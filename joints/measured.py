"""Measured curves: CSV columns with their units in the header, in SI."""

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.table.units import factor_like, split_header


def read_curve(path: Path, columns: Mapping[str, str]) -> dict[str, Array]:
    """Columns {name: example unit} of the CSV at `path`, such as `displacement [um],force [N]`, in SI.

    Raises InputError that names the column and the row for a missing column, unit or number.
    """
    try:
        rows = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read, expected a CSV file") from error
    rows = [row for row in rows if any(cell.strip() for cell in row)]
    if len(rows) < 2:
        raise InputError(f"{path}: no rows, expected a header and numbers")
    header = [cell.strip() for cell in rows[0]]
    curve = {}
    for name, unit in columns.items():
        found = [i for i, cell in enumerate(header) if split_header(cell)[0] == name]
        expected = f"expected a column '{name} [{unit}]'"
        given = split_header(header[found[0]])[1] if len(found) == 1 else None
        if given is None:
            raise InputError(f"{path}: columns {', '.join(header)}, {expected}")
        factor = factor_like(given, unit)
        if factor is None:
            raise InputError(f"{path}: column '{header[found[0]]}', {expected}")
        curve[name] = factor * np.array(
            [_number(row, found[0], f"{path}: row {i}, column '{name}'") for i, row in enumerate(rows[1:], 2)]
        )
    return curve


def _number(row: list[str], index: int, where: str) -> float:
    cell = row[index].strip() if index < len(row) else ""
    try:
        value = float(cell)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputError(f"{where}: '{cell}', expected a number")
    return value
