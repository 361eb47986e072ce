"""Which poses train and which are held out; poses that belong together stay together."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import IntArray
from gpmodel.errors import InputError
from gpmodel.table.dataset import Dataset


def bundles(dataset: Dataset) -> IntArray:
    """Bundle index (N,) of each pose: its `group`, else its `repeat`, else poses with equal joint values."""
    for column in ("group", "repeat"):
        labels = dataset.label(column)
        if (labels != "").any():
            alone = np.array([f"\0{i}" for i in range(len(dataset))])
            return np.unique(np.where(labels == "", alone, labels), return_inverse=True)[1]
    rounded = np.round(np.column_stack([dataset.q, dataset.payload]), 9)
    return np.unique(rounded, axis=0, return_inverse=True)[1].reshape(-1)


def hold_out(dataset: Dataset, fraction: float, rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Rows to train on and rows held out (about `fraction` of the poses, whole bundles), both sorted.

    Raises InputError when the bundles leave nothing on either side.
    """
    if not 0.0 < fraction < 1.0:
        raise InputError(f"--holdout {fraction}: expected a share between 0 and 1, as in 0.3")
    of_pose = bundles(dataset)
    order = rng.permutation(of_pose.max() + 1)
    sizes = np.bincount(of_pose)[order]
    held = order[: int(np.searchsorted(np.cumsum(sizes), fraction * len(dataset), side="left")) + 1]
    mask = np.isin(of_pose, held)
    if mask.all() or not mask.any():
        raise InputError(f"{dataset.source}: no poses can be held out; expected at least 2 groups of poses")
    return np.flatnonzero(~mask), np.flatnonzero(mask)


def folds(dataset: Dataset, count: int, rng: np.random.Generator) -> IntArray:
    """Fold index (N,) for cross-validation, whole bundles, folds of nearly equal size."""
    of_pose = bundles(dataset)
    n = int(of_pose.max()) + 1
    fold_of_bundle: NDArray[np.int64] = np.empty(n, dtype=np.int64)
    fold_of_bundle[rng.permutation(n)] = np.arange(n) % min(count, n)
    return fold_of_bundle[of_pose]


def noise_floor(dataset: Dataset) -> float | None:
    """RMS 3-D distance, m, of repeated measurements from their own mean, or None without repeats.

    σ² = Σ |p - mean|² / Σ (n - 1) over poses with n repeats (same `repeat` label).
    """
    labels = dataset.label("repeat")
    total, freedom = 0.0, 0
    for label in np.unique(labels[labels != ""]):
        points = dataset.position[labels == label]
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) > 1:
            total += float(np.sum((points - points.mean(axis=0)) ** 2))
            freedom += len(points) - 1
    return float(np.sqrt(total / freedom)) if freedom else None
