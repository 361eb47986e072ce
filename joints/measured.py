"""Measured curves: tables with their units in the header, in SI."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError, choices
from gpmodel.table.cells import numbers, read_frame
from gpmodel.table.units import factor_like, split_header
from joints.settings import Settings


def curve_of(settings: Settings, path: Path | None, columns: Mapping[str, str]) -> dict[str, Array] | None:
    """The curve whose `file` a table [measured] names, beside the TOML file at `path`; None where it names none."""
    return None if settings["file"] == "none" else read_curve((path or Path()).parent / settings["file"], columns)


def read_curve(path: Path, columns: Mapping[str, str]) -> dict[str, Array]:
    """Columns {name: example unit} of the table at `path`, such as `displacement [um],force [N]`, in SI.

    Raises InputError that names the column and the row for a missing column, unit or number.
    """
    frame, curve = read_frame(path)[0], dict[str, Array]()
    heads = {str(head): split_header(str(head)) for head in frame.columns}
    for name, unit in columns.items():
        found = next((head for head, (called, given) in heads.items() if called == name and given is not None), "")
        factor = factor_like(heads[found][1] or "", unit) if found else None
        if factor is None:
            raise InputError(f"{path}: columns {choices(name, heads)}, expected a column '{name} [{unit}]'")
        curve[name] = factor * numbers(frame[found], f"{path}: column '{name}'")
        if (empty := np.flatnonzero(np.isnan(curve[name]))).size:
            raise InputError(f"{path}: column '{name}', row {empty[0] + 1}: empty, expected a number")
    return curve
