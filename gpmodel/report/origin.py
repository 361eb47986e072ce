"""Origin of a report: command, versions, table; accuracy by ISO 9283; particulars of a certificate."""

import dataclasses
import datetime
import hashlib
import importlib.metadata
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.comparison import Step
from gpmodel.calibration.directions import LARGEST_LEVERAGE
from gpmodel.calibration.result import Calibration, problem_at, resolved
from gpmodel.errors import InputError, choices
from gpmodel.mechanism.branches import tip_at_trial
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import Poses, observe
from gpmodel.model.observation import Orientation, observations
from gpmodel.model.sites import names_of
from gpmodel.model.states import States
from gpmodel.report.fitted import root_residual
from gpmodel.report.schema import DataRecord, MechanismRecord, NoiseSource
from gpmodel.report.schema_search import InstrumentRecord, Positioning, Range, Repeatability
from gpmodel.table.blocks import different_poses, noise_floor, repeats_drift, replicates
from gpmodel.table.dataset import Dataset
from gpmodel.texts import read_toml

PACKAGES = ("gpmodel", "numpy", "scipy", "numba", "deap", "pin", "sympy")


@dataclass(frozen=True)
class Origin:
    """Command, table and options of a report. noise: stated standard deviation of one coordinate, m, or None."""

    command: str
    seed: int
    seconds: float = 0.0
    noise: float | None = None


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that affect the numbers of a report."""
    out = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            out[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return out


def mechanism_record(mechanism: Mechanism, names: Mapping[str, str]) -> MechanismRecord:
    """Return the report's record of the mechanism, with the joint names of the table."""
    x, y, z = tip_at_trial(mechanism).tolist()
    sliding = tuple(names[j.name] for j in mechanism.joints if j.kind == "prismatic")
    return MechanismRecord(mechanism.name, tuple(names[j.name] for j in mechanism.joints), (x, y, z), sliding)


def data_record(poses: Poses, train: int, outliers: IntArray) -> DataRecord:
    """Return the report's record of the table: file, held-out poses, joint ranges, and row numbers of outliers."""
    data = poses.dataset
    return DataRecord(
        file=data.source,
        sha256=data.sha256,
        poses=len(data),
        different=different_poses(data),
        train=train,
        heldout=len(data) - train,
        outliers=tuple(data.row[outliers].tolist()),
        ranges=ranges(poses.states, data.joints, names_of(data)),
        marks=marks(data),
    )


def marks(data: Dataset) -> tuple[str, ...]:
    """Return eight digits of a digest of the joint values and measurements of each row.
    No digest is returned if the table has kinds of measurements that columns cannot represent."""
    if data.observations:
        return ()
    readings = [data.position, data.rotation, *(data.distances[name] for name in sorted(data.distances))]
    values = np.ascontiguousarray(np.column_stack([data.q, *readings]))
    return tuple(hashlib.sha256(row.tobytes()).hexdigest()[:8] for row in values)


def ranges(states: States, inputs: tuple[str, ...], names: Mapping[str, str]) -> tuple[Range, ...]:
    """Return the ranges of some inputs over the poses; angles in degrees, lengths in mm."""
    out = []
    for name in inputs:
        si = states.unit(name)
        factor, unit = {"rad": (180 / np.pi, "deg"), "m": (1e3, "mm")}.get(si, (1.0, si))
        low, high = float(factor * states[name].min()), float(factor * states[name].max())
        out.append(Range(names.get(name, name), low, high, unit))
    return tuple(out)


def floor_mm(
    fit: Calibration, poses: Poses, noise: float | None, values: float | None = None
) -> tuple[float | None, NoiseSource | None]:
    """Return the 3-D RMS of the measurement noise, mm, and its source: repeats, stated noise, or specification.

    Sources are tried in the order above. Repeats that drift are no source; without another, the source is "drift" and
    the noise unknown. Repeats are compared after subtraction of predictions, because the temperatures of repeats may
    differ. A stated noise is the standard deviation σ of one coordinate; with c measured components the RMS is σ √c.
    values: number of components left to the fit if solved joint values absorb the others.
    """
    data = poses.dataset
    observed = observe(fit.model, resolved(fit, poses), fit.theta, fit.placement)
    left = dataclasses.replace(data, position=data.position - observed.tip[:, :3, 3])
    repeats, drift = noise_floor(left), repeats_drift(left)
    if repeats is not None and not drift:
        return 1e3 * repeats, "repeats"
    sigma = noise if noise is not None or data.instrument is None else data.instrument.noise(data.position)
    if sigma is None:
        return None, "drift" if drift else None
    measured = sum(float(kind.readings.sum()) for kind in observations(data) if not isinstance(kind, Orientation))
    measured = measured if values is None else values
    return float(1e3 * sigma * np.sqrt(measured / len(data))), "specification" if noise is None else "instrument"


def instrument_record(data: Dataset) -> InstrumentRecord | None:
    """Return the noise expected from the instrument's specification at the measured distances, or None."""
    stated, points = data.instrument, data.position
    if stated is None:
        return None
    return InstrumentRecord(str(stated), 1e3 * stated.at(points), 1e3 * stated.noise(points))


FEWEST = 3
"""Least number of repeats of a pose for a standard deviation, and of poses for the spread between poses."""
REPEATS = 30
"""Number of repeats of every pose by ISO 9283, table 7."""


def repeatability(data: Dataset) -> Repeatability | None:
    """Return the pose repeatability RP of ISO 9283, 7.2.2, over the repeats of each pose; None without repeats.

    RP is l + 3 S, with mean l and standard deviation S (n - 1) of the distances of the repeats from their mean
    position. The uncertainty of the mean RP is computed from the spread between poses. With fewer repeats than the 30
    of the standard, RP is too small.
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
    """Return the pose accuracy of ISO 9283, 7.2.1: distance of the mean of a pose's repeats from its modelled position.

    Before calibration: nominal geometry with fitted registration and tool. After calibration: the last model. Pose
    accuracy is that of held-out poses; with fewer than three, that of fitted poses, with errors scaled as if left out.
    Pose accuracy is None if fewer than three poses were measured three times.
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
    """Yield the rows of each pose with at least three complete measurements."""
    codes, whole = replicates(data), np.isfinite(data.position).all(axis=1)
    for code in np.unique(codes):
        rows = np.flatnonzero((codes == code) & whole)
        if len(rows) >= FEWEST:
            yield rows


def _left(fit: Calibration, poses: Poses, chosen: Sequence[IntArray]) -> Array:
    """Return the variance of the residual over the variance of the mean of each pose: 1 - leverage."""
    problem, out = problem_at(fit, poses), []
    for rows in chosen:
        columns = problem.columns[np.isin(problem.pose_of_row, rows)]
        mean = fit.sigma**2 * (1.0 / len(rows) + fit.pose_ratio) / (1.0 + fit.pose_ratio)
        taken = float(np.sum((columns @ fit.covariance.values) * columns)) / (len(columns) * mean)
        out.append(1.0 - min(taken, LARGEST_LEVERAGE))
    return np.array(out)


def _mean(values: Array) -> tuple[float, float]:
    """Return the mean of values and its standard uncertainty from the spread of the values."""
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))


@dataclass(frozen=True)
class Particulars:
    """Text fields of an accuracy certificate; an empty field is filled in by hand."""

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
        """Return every text field of the certificate as heading and text."""
        return tuple((f.name.replace("_", " "), getattr(self, f.name)) for f in dataclasses.fields(self))

    def with_lines(self, said: Mapping[str, str]) -> "Particulars":
        """Insert non-empty values into the certificate's text fields. Raises InputError for an unknown field."""
        known = [f.name for f in dataclasses.fields(self)]
        for name in said:
            if name not in known:
                raise InputError(
                    f"'{name}' is no entry of a certificate; available: {choices(name, known)}", "particulars"
                )
        return dataclasses.replace(self, **{name: value for name, value in said.items() if value})


def read_particulars(path: Path) -> Particulars:
    """Read the text fields of a certificate from a TOML file; the keys are the names of the fields.
    Raises InputError for a missing or invalid file, an unknown key, or a value that is not text, number or date."""
    content = read_toml(path, "lines as in serial = '64-10291'")
    known = [f.name for f in dataclasses.fields(Particulars)]
    for key, value in content.items():
        if key not in known:
            raise InputError(f"{path}: key '{key}' is unknown; available: {choices(key, known)}")
        if not isinstance(value, str | int | float | datetime.date) or isinstance(value, bool):
            raise InputError(f"{path}: {key} = {value!r}; expected text")
    return Particulars(**{key: str(value) for key, value in content.items()})
