"""Calibration tables of FIGAROH: markers x1, y1, z1, x2, ... in m, perhaps phix1, phiy1, phiz1 in rad, and a column a
joint, rad and m, without units. Source: thanhndv212/figaroh-plus, calibration/data_loader.py."""

import re
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.cells import numbers, read_frame
from gpmodel.table.imported import Imported, cells, joint_cells, rotation_vectors, surplus_joints

_MARKER = re.compile(r"^(x|y|z|phix|phiy|phiz)(\d+)$")


def is_figaroh(path: Path) -> bool:
    """Whether the header of a CSV file names a first marker."""
    return path.suffix.lower() == ".csv" and {"x1", "y1", "z1"} <= {str(c).strip() for c in read_frame(path)[0].columns}


def figaroh_table(path: Path, mechanism: Mechanism | None) -> Imported:
    """A row a pose and marker: several markers are tools of one setup, rows of one pose one group.

    Raises InputError as `joint_cells`, or where a marker has not all of x, y and z.
    """
    frame, _ = read_frame(path)
    frame.columns = frame.columns.astype(str).str.strip()
    found = [match for match in map(_MARKER.match, frame.columns) if match]
    values = {c: numbers(frame[c], f"{path.name}, column '{c}'") for c in frame.columns}
    beside = {c: v for c, v in values.items() if not _MARKER.match(c)}
    joints = joint_cells(mechanism, beside, path.name)
    parts = []
    markers = sorted({int(match[2]) for match in found})
    for k in markers:
        if missing := [f"{axis}{k}" for axis in "xyz" if f"{axis}{k}" not in values]:
            raise InputError(f"{path.name}: marker {k} has no column '{missing[0]}'; expected x{k}, y{k} and z{k}")
        part = dict(joints) | {f"{axis} [m]": cells(values[f"{axis}{k}"]) for axis in "xyz"}
        angles = [values[name] for axis in "xyz" if (name := f"phi{axis}{k}") in values]
        if len(angles) == 3:
            vectors = rotation_vectors(partial(Rotation.from_euler, "xyz"), np.column_stack(angles))
            part |= {f"r{a} [rad]": cells(v) for a, v in zip("xyz", vectors.T, strict=True)}
        labels = {"group": [str(n + 1) for n in range(len(frame))]} if len(markers) > 1 else {}
        parts.append(pd.DataFrame(part | labels | ({"tool": [str(k)] * len(frame)} if labels else {})))
    table = pd.concat(parts).sort_index(kind="stable").reset_index(drop=True)
    return Imported(table, left_out=surplus_joints(mechanism, beside))
