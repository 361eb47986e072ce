"""Particulars of a certificate (machine, instrument, operator), and repeatability and accuracy by ISO 9283."""

import dataclasses
import datetime
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpmodel.application.further import LARGEST_LEVERAGE
from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.comparison import Step
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.errors import InputError, choices
from gpmodel.model.error_model import Poses
from gpmodel.report.fitted import root_residual
from gpmodel.report.schema_search import Positioning, Repeatability
from gpmodel.table.bundles import replicates
from gpmodel.table.dataset import Dataset
from gpmodel.texts import read_toml

FEWEST = 3
"""Least number of repeats of a pose for their spread, and of poses for the spread between poses."""
REPEATS = 30
"""Repeats of every pose by ISO 9283, table 7."""


def repeatability(data: Dataset) -> Repeatability | None:
    """Return the pose repeatability, 7.2.2: RP = l + 3 S_l over the repeats of a pose; None without repeats.

    l_j: distance of repeat j from the mean of its pose, l and S_l their mean and standard deviation (n - 1). The
    uncertainty of the mean over the poses is from their spread. With fewer repeats than the standard's 30, RP is
    smaller.
    """
    by_pose = [1e3 * np.linalg.norm(data.position[k] - data.position[k].mean(axis=0), axis=1) for k in _repeats(data)]
    if not by_pose:
        return None
    single: Array = np.array([d.mean() + 3 * d.std(ddof=1) for d in by_pose])
    count = sum(len(d) for d in by_pose)
    spread = float(np.sqrt(sum(np.sum(d**2) for d in by_pose) / (count - len(by_pose))))
    mean, stderr = _mean(single) if len(single) > 1 else (float(single[0]), None)
    return Repeatability(len(by_pose), count, spread, mean, float(single.max()), stderr)


def positioning(poses: Poses, train: IntArray, steps: Sequence[Step]) -> Positioning | None:
    """Return the pose accuracy, 7.2.1: distance of the mean of a pose's repeats from its modelled position.

    The model is the nominal geometry (registration and tool alone) before, and that of the last step after. Poses are
    held out; if fewer than FEWEST are, fitted poses are used, with errors scaled as if left out. None if fewer than
    FEWEST poses were measured FEWEST times.
    """
    heldout = ~np.isin(np.arange(len(poses)), train)
    every = list(_repeats(poses.dataset))
    held = [k for k in every if heldout[k].all()]
    fitted = [k for k in every if not heldout[k].any()]
    chosen, fresh = (held, True) if len(held) >= FEWEST else (fitted, False)
    if len(chosen) < FEWEST or poses.dataset.joints_approximate:
        return None
    first, last = steps[0].calibration, steps[-1].calibration
    before, after = (
        np.array([np.linalg.norm(1e3 * r[k].mean(axis=0)) for k in chosen])
        for r in (root_residual(fit, poses) for fit in (first, last))
    )
    if not fresh:
        after = after / _left(last, poses, chosen)
    if not np.isfinite([before, after]).all():
        return None
    (b, db), (a, da) = (_mean(v) for v in (before, after))
    return Positioning(len(chosen), fresh, b, db, a, da, float(after.max()))


def _repeats(data: Dataset) -> Iterator[IntArray]:
    """Yield the rows of each pose with at least FEWEST complete measurements."""
    codes, whole = replicates(data), np.isfinite(data.position).all(axis=1)
    for code in np.unique(codes):
        rows = np.flatnonzero((codes == code) & whole)
        if len(rows) >= FEWEST:
            yield rows


def _left(fit: Calibration, poses: Poses, chosen: Sequence[IntArray]) -> Array:
    """Return the share (P,) of the variance of a pose's mean in its residual: 1 - its leverage."""
    problem, out = problem_at(fit, poses), []
    for rows in chosen:
        columns = problem.columns[np.isin(problem.pose_of_row, rows)]
        mean = fit.sigma**2 * (1.0 / len(rows) + fit.pose_ratio) / (1.0 + fit.pose_ratio)
        taken = float(np.sum((columns @ fit.covariance.values) * columns)) / (len(columns) * mean)
        out.append(1.0 - min(taken, LARGEST_LEVERAGE))
    return np.array(out)


def _mean(values: Array) -> tuple[float, float]:
    """Return the mean and its standard uncertainty from the spread of the values."""
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))


@dataclass(frozen=True)
class Particulars:
    """Free text of a certificate; an empty line is filled in by hand."""

    machine: str = ""
    serial: str = ""
    controller: str = ""
    location: str = ""
    instrument: str = ""
    instrument_serial: str = ""
    instrument_calibrated: str = ""
    operator: str = ""
    date: str = ""
    temperature: str = ""
    payload: str = ""
    remarks: str = ""

    def lines(self) -> tuple[tuple[str, str], ...]:
        """Return every line as heading and text."""
        return tuple((f.name.replace("_", " "), getattr(self, f.name)) for f in dataclasses.fields(self))

    def with_lines(self, said: Mapping[str, str]) -> "Particulars":
        """Return the particulars with the non-empty lines replaced. Raises InputError for an unknown line."""
        known = [f.name for f in dataclasses.fields(self)]
        for name in said:
            if name not in known:
                raise InputError(
                    f"'{name}' is no line of a certificate; available: {choices(name, known)}", "particulars"
                )
        return dataclasses.replace(self, **{name: value for name, value in said.items() if value})


def read_particulars(path: Path) -> Particulars:
    """Read particulars from a TOML file with keys of the same names.
    Raises InputError for a missing or invalid file, an unknown key, or a value that is not text, number or date."""
    content = read_toml(path, "lines as in serial = '64-10291'")
    known = [f.name for f in dataclasses.fields(Particulars)]
    for key, value in content.items():
        if key not in known:
            raise InputError(f"{path}: key '{key}' is unknown; available: {choices(key, known)}")
        if not isinstance(value, str | int | float | datetime.date) or isinstance(value, bool):
            raise InputError(f"{path}: {key} = {value!r}; expected text")
    return Particulars(**{key: str(value) for key, value in content.items()})
