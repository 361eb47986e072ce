"""Torques that the table has measured: they are the load of their joint, in place of what gravity is computed to do."""

import re
from collections.abc import Iterator

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import choices
from gpmodel.mechanism.protocol import Joint, Mechanism
from gpmodel.table.dataset import Dataset
from gpmodel.table.units import torque_factor

_SPELLED = re.compile(r"(?:measured_)?(?:torque|tau|effort|trq)_(?P<joint>\w+?)(?:_measured)?$", re.IGNORECASE)


def measured_torques(mechanism: Mechanism, dataset: Dataset) -> dict[str, str]:
    """Joint -> column of its measured torque, as `torque_J2`, `tau_2`, `effort_elbow_joint`, in any unit of torque (of
    force for a joint that slides); columns that are the same in all of several rows are none."""
    varies = {c for c, values in dataset.extras.items() if len(values) == 1 or np.ptp(values) > 0}
    return {j.name: c for j, c in torque_columns(mechanism, dataset) if c in varies}


def measured_torque(dataset: Dataset, column: str) -> Array:
    """The column (N,) in N·m or N, signed as the table has it: a drive at rest exerts minus what gravity does."""
    return dataset.extras[column] * (torque_factor(dataset.extra_units[column]) or 1.0)


def unused_torques(mechanism: Mechanism, dataset: Dataset) -> Iterator[str]:
    """One sentence for every column of torques that is not the load of a joint."""
    of_joints = {column: joint for joint, column in torque_columns(mechanism, dataset)}
    for column, unit in dataset.extra_units.items():
        if column not in of_joints and _SPELLED.match(column) and torque_factor(unit):
            yield (
                f"{dataset.source}: column '{column}' names no joint of {mechanism.name} and is an input like any "
                f"other; expected {choices(column, (f'torque_{joint.name}' for joint in mechanism.joints))}"
            )
    for column, joint in of_joints.items():
        if not np.ptp(dataset.extras[column]) > 0:
            yield (
                f"{dataset.source}: column '{column}' is {dataset.extras[column][0]:g} in every row and is not used "
                f"as the torque of {joint.name}; expected what the joint bears at each pose"
            )


def torque_columns(mechanism: Mechanism, dataset: Dataset) -> Iterator[tuple[Joint, str]]:
    """Each joint with its column of measured torques, by its name in mechanism or table or its number."""
    tables = dataset.columns or dataset.joints
    called: dict[str, Joint] = {}
    for i, (joint, table) in enumerate(zip(mechanism.joints, tables, strict=True), 1):
        called |= {name.lower(): joint for name in (str(i), f"j{i}", table, joint.name)}
    for column in dataset.extras:
        match = _SPELLED.match(column)
        if match and match["joint"].lower() in called and torque_factor(dataset.extra_units[column]):
            yield called[match["joint"].lower()], column
