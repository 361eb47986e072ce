"""Datasets written back as tables."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.dataset import Dataset
from gpmodel.table.units import joint_column, split_header

_DIGITS = {"deg": 9, "rad": 11}
"""Decimals of an angle: a nanoradian or less."""
CONTROLLER_DECIMALS = 4
"""Decimals of a degree or a millimetre that a controller takes."""


def frame_of(dataset: Dataset, mechanism: Mechanism) -> pd.DataFrame:
    """Text cells with units in the headers: joints [deg] or [mm], inputs, payload [kg], labels, what was measured.

    Unmeasured components are empty cells.
    """
    names = tuple(joint.name for joint in mechanism.joints)
    frame = replace(dataset, columns=names, kinds=tuple(joint.kind for joint in mechanism.joints), extra_names={})
    cells = frame.to_dataframe().drop(columns="row")
    nowhere = ~np.isfinite(dataset.position).any(axis=0)
    cells = cells.drop(columns=[f"{axis} [mm]" for axis in np.array(list("xyz"))[nowhere]])
    fine = {*names, *dataset.extras, "rx", "ry", "rz"}
    for header, column in cells.items():
        if pd.api.types.is_float_dtype(column):
            cells[header] = _cells(column.to_numpy(), 9 if split_header(str(header))[0] in fine else 6)
    return cells


def with_results(
    frame: pd.DataFrame, results: Mapping[str, Array | list[str]], prefixes: tuple[str, ...]
) -> pd.DataFrame:
    """Add computed columns by header. Columns of an earlier run, of their names or with these prefixes, are dropped."""
    names = {split_header(header)[0] for header in results}
    old = [c for c in frame.columns if (name := split_header(str(c))[0]) in names or name.startswith(prefixes)]
    return frame.drop(columns=old).assign(**results)


def joint_table(mechanism: Mechanism, q: Array, names: Sequence[str] = ()) -> pd.DataFrame:
    """Joint values (N, n), rad and m, a row for each pose, with units in the headers; names: of the columns, by default
    those of the joints."""
    columns = zip(names or [joint.name for joint in mechanism.joints], mechanism.joints, q.T, strict=True)
    return pd.DataFrame(dict(joint_column(name, joint.kind, values) for name, joint, values in columns))


def table_text(frame: pd.DataFrame, decimals: int | None = None) -> str:
    """CSV text: nine decimals of an angle, six of every other number, nothing where there is none.

    decimals: of all of them.
    """
    cells = frame.copy()
    for header, column in frame.items():
        if pd.api.types.is_float_dtype(column):
            digits = decimals or _DIGITS.get(split_header(str(header))[1] or "", 6)
            cells[header] = _cells(column.to_numpy(dtype=float, na_value=np.nan), digits)
    return cells.to_csv(index=False, lineterminator="\n")


def _cells(values: np.ndarray, digits: int) -> list[str]:
    return ["" if np.isnan(v) else f"{v:.{digits}f}" for v in values]
