"""Poses within the measured ranges that nobody measured."""

from dataclasses import replace

import numpy as np

from gpmodel.application.matching import matched, remembered
from gpmodel.application.model_file import SavedModel
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.table.dataset import Dataset


def measured_table(saved: SavedModel) -> Dataset:
    """The table the model was fitted to, made fit for it. Raises InputError where the model does not have it."""
    if saved.measured is None:
        raise InputError("model: does not hold the table it was fitted to; calibrate or discover again")
    return remembered(saved, matched(saved, saved.measured.dataset))


def fresh_poses(saved: SavedModel, count: int, rng: np.random.Generator) -> Dataset:
    """`count` poses, joint values uniform over the measured ranges, everything else as in random rows of the table.

    Raises InputError as `measured_table`.
    """
    data = measured_table(saved)
    return at_joint_values(data, rng.uniform(data.q.min(axis=0), data.q.max(axis=0), (count, data.q.shape[1])), rng)


def at_joint_values(data: Dataset, q: Array, rng: np.random.Generator) -> Dataset:
    """Unmeasured poses at q (N, n), everything else as in random rows of `data`."""
    rows = rng.integers(0, len(data), len(q))
    blank = np.full((len(q), 3), np.nan)
    taken = data.subset(rows)
    return replace(taken, q=q, position=blank, rotation=blank.copy(), distances={}, in_order=False)
