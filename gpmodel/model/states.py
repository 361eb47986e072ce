"""What a basis may read: named, unit-carrying columns, one value a pose."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.numerics.se3 import chain
from gpmodel.table.dataset import Dataset

PAYLOAD_SHARE = "payload_"


@dataclass(frozen=True)
class States:
    """Columns (N,) by name, and their units.

    Joint names (rad or m), x y z (nominal tip in the mechanism's root frame, m), the mechanism's loads (Nm, N),
    payload (kg, when the table has it; where it varies, payload_torque_J2 is what it alone exerts),
    the table's extra columns in their own units, and row (from 1).
    """

    columns: Mapping[str, Array]
    units: Mapping[str, str]

    def __getitem__(self, name: str) -> Array:
        try:
            return self.columns[name]
        except KeyError:
            available = ", ".join(self.columns)
            raise InputError(f"input '{name}' is not known here; available: {available}") from None

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def subset(self, rows: IntArray | Mask) -> "States":
        """The same columns at some poses only."""
        return States(MappingProxyType({k: v[rows] for k, v in self.columns.items()}), self.units)

    def between(self, count: int = 2000) -> "States":
        """Columns (count,) at random places on straight lines between pairs of poses: where nobody measured."""
        rng = np.random.default_rng(0)
        first, second = rng.integers(0, len(self), (2, count))
        part = rng.random(count)
        mixed = {k: v[first] + part * (v[second] - v[first]) for k, v in self.columns.items()}
        return States(MappingProxyType(mixed), self.units)


def load_unit(name: str) -> str:
    """The unit of a load by the prefix of its name: N for forces, Nm for torques and moments."""
    return "N" if name.startswith("force_") else "Nm"


def states_of(mechanism: Mechanism, dataset: Dataset) -> States:
    """Every column a basis may read for the poses of `dataset`."""
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}

    def put(name: str, values: Array, unit: str) -> None:
        if name in columns:
            raise InputError(f"column '{name}' collides with a built-in input; rename it in the table")
        columns[name], units[name] = np.asarray(values, dtype=float), unit

    for i, joint in enumerate(mechanism.joints):
        put(joint.name, dataset.q[:, i], "rad" if joint.kind == "revolute" else "m")
    tip = chain(mechanism.transforms(dataset.q))[-1][:, :3, 3]
    for name, values in zip("xyz", tip.T, strict=True):
        put(name, values, "m")
    loads = mechanism.loads(dataset.q, dataset.payload)
    for name, values in loads.items():
        put(name, values, load_unit(name))
    if dataset.payload_given:
        put("payload", dataset.payload, "kg")
        if np.ptp(dataset.payload) > 0:
            bare = mechanism.loads(dataset.q, np.zeros(len(dataset)))
            for joint in mechanism.joints:
                load = f"torque_{joint.name}"
                put(f"{PAYLOAD_SHARE}{load}", loads[load] - bare.get(load, 0.0), "Nm")
    for name, values in dataset.extras.items():
        put(name, values, dataset.extra_units[name])
    put("row", dataset.row.astype(float), "1")
    return States(MappingProxyType(columns), MappingProxyType(units))
