"""Datasets written back as tables."""

import numpy as np
import pandas as pd

from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.dataset import READINGS, Dataset
from gpmodel.table.units import split_header

_DIGITS = {"deg": 9, "rad": 11}
"""Decimals of an angle: a nanoradian or less."""


def frame_of(dataset: Dataset, mechanism: Mechanism) -> pd.DataFrame:
    """Text cells with units in the headers: joints [deg] or [mm], inputs, payload [kg], labels, what was measured.

    Unmeasured components are empty cells.
    """
    columns: dict[str, list[str]] = {}
    for joint, values in zip(mechanism.joints, dataset.q.T, strict=True):
        header, scaled = joint_column(joint.name, joint.kind, values)
        columns[header] = _cells(scaled, 9)
    for name, values in dataset.extras.items():
        columns[f"{name} [{dataset.extra_units[name]}]"] = _cells(values, 9)
    if dataset.payload_given:
        columns["payload [kg]"] = _cells(dataset.payload, 6)
    columns |= {name: list(values) for name, values in dataset.labels.items()}
    for i, axis in enumerate("xyz"):
        if np.isfinite(dataset.position[:, i]).any():
            columns[f"{axis} [mm]"] = _cells(1e3 * dataset.position[:, i], 6)
    if dataset.has_rotation:
        for i, axis in enumerate("xyz"):
            columns[f"r{axis} [deg]"] = _cells(np.degrees(dataset.rotation[:, i]), 9)
    for name, values in dataset.distances.items():
        columns[f"{name} [mm]"] = _cells(1e3 * values, 6)
    for name, values in dataset.readings.items():
        unit, factor = {"px": ("px", 1.0), "m": ("mm", 1e3), "rad": ("deg", np.degrees(1.0))}[READINGS[name]]
        columns[f"{name} [{unit}]"] = _cells(factor * values, 6)
    return pd.DataFrame(columns)


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


def joint_column(name: str, kind: str, values: np.ndarray) -> tuple[str, np.ndarray]:
    """Header and values of a joint column as it is written: [deg] for revolute joints, [mm] for prismatic ones."""
    return (f"{name} [deg]", np.degrees(values)) if kind == "revolute" else (f"{name} [mm]", 1e3 * values)


def _cells(values: np.ndarray, digits: int) -> list[str]:
    return ["" if np.isnan(v) else f"{v:.{digits}f}" for v in values]
