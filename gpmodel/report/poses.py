"""Residuals pose by pose: a table of the report page, and the file poses.csv."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from gpmodel.arrays import Array, Mask
from gpmodel.report.fitted import optional
from gpmodel.report.picture import numbers
from gpmodel.report.schema import Report

CSV = "poses.csv"
DECIMALS = 4
"""Number of decimals of a residual in mm: a tenth of a micrometre."""


@dataclass(frozen=True)
class PoseError:
    """3-D errors of one pose, mm, before and after calibration or the added effects; None if not measured."""

    row: int
    heldout: bool
    outlier: bool
    before: float | None
    after: float | None


def pose_errors(report: Report, steps: tuple[str, str] | None = None) -> tuple[PoseError, ...]:
    """Return the errors of all poses, in order of decreasing error after calibration.
    steps: names of the models before and after; by default the two models that the report compares."""
    before, after = (errors_of(report, step) for step in steps or report.before_and_after())
    rows = report.plots.rows or tuple(range(1, len(after) + 1))
    outliers = set(report.data.outliers)
    poses = [
        PoseError(row, held, row in outliers, optional(b), optional(a))
        for row, held, b, a in zip(rows, report.plots.heldout_mask, before, after, strict=False)
    ]
    return tuple(sorted(poses, key=lambda p: -(p.after if p.after is not None else -1.0)))


def csv(report: Report) -> str:
    """Return the text of poses.csv in the order of the rows.

    The columns are the 3-D error and its components before and after calibration, in mm, and the orientation error, in
    mrad. Components of errors and nominal positions are in the root frame.
    """
    poses, plots = sorted(pose_errors(report), key=lambda p: p.row), report.plots
    frame = pd.DataFrame(
        {
            "row": [p.row for p in poses],
            "set": ["held out" if p.heldout else "training" for p in poses],
            "outlier": [int(p.outlier) for p in poses],
            "before [mm]": [p.before for p in poses],
            "after [mm]": [p.after for p in poses],
        }
    )
    if not poses:
        return frame.to_csv(index=False, lineterminator="\n")
    before = "standard" if report.before_and_after()[0] == "standard" else "registration"
    for name, residual in (("before", before), ("after", "final")):
        if len(plots.residual_mm.get(residual, ())) == len(poses):
            frame[[f"{name}_{a} [mm]" for a in "xyz"]] = numbers(plots.residual_mm[residual])
        if len(plots.turn_mrad.get(residual, ())) == len(poses):
            frame[f"{name} [mrad]"] = numbers(plots.turn_mrad[residual])
    if len(plots.points_mm) == len(poses):
        frame[[f"nominal_{a} [mm]" for a in "xyz"]] = numbers(plots.points_mm)
    return frame.round(DECIMALS).to_csv(index=False, lineterminator="\n")


def counted(report: Report) -> Mask:
    """Return a mask of the poses without outliers: of the held-out poses, or of all poses if none were held out."""
    held = np.array(report.plots.heldout_mask, dtype=bool)
    rows = report.plots.rows or range(1, len(held) + 1)
    return np.isin(list(rows), report.data.outliers, invert=True) & (held | (not report.held))


def errors_of(report: Report, step: str) -> Array:
    """Return the error of every pose, mm, after a step of the calibration; empty if the report has none."""
    held = np.array(report.plots.heldout_mask, dtype=bool)
    sides = report.plots.error_mm.get(step)
    if sides is None or len(sides.heldout) != held.sum() or len(sides.train) != (~held).sum():
        return np.zeros(0)
    out = np.empty(len(held))
    out[held], out[~held] = numbers(sides.heldout), numbers(sides.train)
    return out
