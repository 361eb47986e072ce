"""The measured table that a model was fitted to, saved with the model for exports and for the choice of
further poses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gpmodel.application.model_reader import MeasuredPart
from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.inclination import Inclination
from gpmodel.model.instruments import with_observations
from gpmodel.model.observation import observations
from gpmodel.model.pixel import Pixels
from gpmodel.model.touches import Touches
from gpmodel.table.dataset import Dataset
from gpmodel.table.units import identifier


@dataclass(frozen=True)
class Measured:
    """A table, and the indices of its rows that were held out of selection."""

    dataset: Dataset
    heldout: IntArray


def measured_record(measured: Measured | None) -> dict[str, object] | None:
    """Return the measured table as JSON, SI; None without a table, or with a kind of measurement that tables cannot
    hold."""
    if measured is None or not all(
        isinstance(o, Touches | Pixels | Inclination) for o in measured.dataset.observations
    ):
        return None
    data = measured.dataset
    return {
        "file": Path(data.source).name,
        "sha256": data.sha256,
        "row": data.row,
        "heldout": measured.heldout,
        "q": data.q,
        "position_m": data.position,
        "rotation_rad": data.rotation if data.has_rotation else None,
        "distances_m": dict(data.distances),
        "payload_kg": data.payload if data.payload_given else None,
        "labels": {name: values.tolist() for name, values in data.labels.items()},
        "extras": dict(data.extras),
        "extra_units": dict(data.extra_units),
        "columns": data.columns,
        "in_order": data.in_order,
        "readings": dict(data.readings),
        "described": dict(data.described),
        "counted_m": {kind.name: kind.metres for kind in observations(data) if kind.unit != "m" and kind.metres},
    }


def measured_from(record: MeasuredPart, mechanism: Mechanism) -> Measured:
    """Read the record of `measured_record`. Raises InputError if its joints differ."""
    joints = mechanism.joints
    count = len(record.row)
    if {len(row) for row in record.q} - {len(joints)}:
        raise InputError(f"measured.q: expected {len(joints)} values a row, those of the joints")
    known = [{joint.name, f"J{i}"} for i, joint in enumerate(joints, 1)]
    words = [identifier(column) for column in record.columns]
    if record.columns and (len(words) != len(joints) or any(w not in of for w, of in zip(words, known, strict=True))):
        raise InputError(f"measured.columns: expected the {len(joints)} joints, by their names or as J1, J2, ...")
    rotation, payload = record.rotation_rad, record.payload_kg
    dataset = Dataset(
        joints=tuple(joint.name for joint in joints),
        kinds=tuple(joint.kind for joint in joints),
        q=_numbers(record.q).reshape(count, len(joints)),
        position=_numbers(record.position_m).reshape(count, 3),
        rotation=np.full((count, 3), np.nan) if rotation is None else _numbers(rotation).reshape(count, 3),
        row=np.array(record.row, dtype=np.int64),
        payload=np.zeros(count) if payload is None else _numbers(payload),
        distances={name: _numbers(values) for name, values in record.distances_m.items()},
        labels={name: np.array(values, dtype=str) for name, values in record.labels.items()},
        extras={name: _numbers(values) for name, values in record.extras.items()},
        extra_units=record.extra_units,
        payload_given=payload is not None,
        source=record.file,
        sha256=record.sha256,
        columns=record.columns,
        joints_approximate=not all(joint.measured for joint in joints),
        in_order=record.in_order,
        readings={name: _numbers(values) for name, values in record.readings.items()},
        described=record.described,
    )
    dataset = counted(with_observations(dataset, mechanism), record.counted_m)
    return Measured(dataset, np.array(record.heldout, dtype=np.int64))


def counted(dataset: Dataset, metres: Mapping[str, float]) -> Dataset:
    """Return the dataset with the weights of pixels and angles from `metres`, by name of the instrument."""
    return replace(
        dataset,
        observations=tuple(
            replace(kind, metres=metres[kind.name])
            if isinstance(kind, Pixels | Inclination) and kind.name in metres
            else kind
            for kind in dataset.observations
        ),
    )


def _numbers(values: Sequence[object]) -> Array:
    """Return numbers as an array, null as NaN."""
    return np.array(values, dtype=float)
