"""Origin of a report: command, versions, table."""

import hashlib
import importlib.metadata
import platform
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.mechanism.branches import tip_at_probe
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import Poses
from gpmodel.model.observation import observations
from gpmodel.model.sites import names_of
from gpmodel.model.states import States
from gpmodel.report.schema import DataRecord, MechanismRecord, NoiseSource
from gpmodel.report.schema_search import InstrumentRecord, Range
from gpmodel.table.bundles import different_poses, noise_floor
from gpmodel.table.dataset import Dataset

PACKAGES = ("gpmodel", "numpy", "scipy", "numba", "deap", "pin", "sympy")


@dataclass(frozen=True)
class Origin:
    """Request behind a report. noise: standard deviation of one coordinate by the instrument, m, if given."""

    command: str
    seed: int
    seconds: float = 0.0
    noise: float | None = None


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that affect the numbers."""
    out = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            out[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return out


def mechanism_record(mechanism: Mechanism, names: Mapping[str, str]) -> MechanismRecord:
    """Return the record of the mechanism, with the joint names of the table."""
    x, y, z = tip_at_probe(mechanism).tolist()
    sliding = tuple(names[j.name] for j in mechanism.joints if j.kind == "prismatic")
    return MechanismRecord(mechanism.name, tuple(names[j.name] for j in mechanism.joints), (x, y, z), sliding)


def data_record(poses: Poses, train: int, outliers: IntArray) -> DataRecord:
    """Return the record of the table: its file, split, joint ranges, and `outliers` (K,) by index of the pose."""
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
    Empty if there are kinds of measurements that columns do not hold."""
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
    data: Dataset, noise: float | None, values: float | None = None
) -> tuple[float | None, NoiseSource | None]:
    """Return the 3-D RMS of the measurement noise, mm, and its source: repeats, stated noise, or specification.

    The first available source is used. A stated σ is of one coordinate; for a pose with c measured components the RMS
    is σ √c. values: number of components that inform the model, if solved joint values absorb the others.
    """
    repeats = noise_floor(data)
    if repeats is not None:
        return 1e3 * repeats, "repeats"
    sigma = noise if noise is not None or data.instrument is None else data.instrument.noise(data.position)
    if sigma is None:
        return None, None
    measured = sum(float(kind.readings.sum()) for kind in observations(data) if kind.metres is not None)
    measured = measured if values is None else values
    return float(1e3 * sigma * np.sqrt(measured / len(data))), "specification" if noise is None else "instrument"


def instrument_record(data: Dataset) -> InstrumentRecord | None:
    """Return the noise expected from the instrument's specification at the table's distances; None without one."""
    stated, points = data.instrument, data.position
    if stated is None:
        return None
    return InstrumentRecord(str(stated), 1e3 * stated.at(points), 1e3 * stated.noise(points))
