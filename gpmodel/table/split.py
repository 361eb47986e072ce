"""Split into training and held-out poses; dependent poses stay together."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.table.bundles import bundles
from gpmodel.table.dataset import Dataset

FEWEST_HELD, USUAL = 5, 0.3
"""Poses held out at least, of tables whose usual share has as many: the p-value of fewer, all better, is above 3 %."""

JUDGED = 0
"""Seed of every split, fold and permutation that a discovery is judged by: the same for every seed of its search, so
that what is found does not hang on which poses a number happened to hold out (experiments/seeds)."""


def hold_out(dataset: Dataset, fraction: float, rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Rows (T,) to train on and rows (H,) held out (about `fraction` of the poses, whole bundles), both sorted.

    Raises InputError where all poses are one bundle, or `fraction` leaves none to train on or hardly any held out.
    """
    if not 0.0 < fraction < 1.0:
        raise InputError(f"{fraction}, expected a share above 0 and below 1, as in 0.3", "holdout")
    of_pose = bundles(dataset)
    order = rng.permutation(of_pose.max() + 1)
    sizes = np.bincount(of_pose)[order]
    held = order[: int(np.searchsorted(np.cumsum(sizes), fraction * len(dataset), side="left")) + 1]
    mask = np.isin(of_pose, held)
    if len(order) < 2:
        raise InputError(f"{dataset.source}: no poses can be held out; expected at least 2 groups of poses")
    usual = min(FEWEST_HELD, int(USUAL * len(dataset)))
    if mask.sum() < usual:
        raise InputError(
            f"{fraction:g} of {len(dataset)} poses holds out {int(mask.sum())}, which prove nothing; expected at least "
            f"{FEWEST_HELD}, as with {np.ceil(100 * FEWEST_HELD / len(dataset)) / 100:g}",
            "holdout",
        )
    if mask.all():
        groups = "" if len(order) == len(dataset) else f" in {len(order)} groups"
        raise InputError(
            f"{fraction:g} of {len(dataset)} poses{groups} leaves none to train on; expected less, as in 0.3", "holdout"
        )
    return np.flatnonzero(~mask), np.flatnonzero(mask)


def folds(dataset: Dataset, count: int, rng: np.random.Generator) -> IntArray:
    """Fold index (N,) for cross-validation, whole bundles, folds of nearly equal size."""
    of_pose = bundles(dataset)
    n = int(of_pose.max()) + 1
    fold_of_bundle: NDArray[np.int64] = np.empty(n, dtype=np.int64)
    fold_of_bundle[rng.permutation(n)] = np.arange(n) % min(count, n)
    return fold_of_bundle[of_pose]


def stretches(row: Array, count: int) -> IntArray:
    """Code (N,) of the stretch that each value of `row` (N,) lies in, of `count` with nearly equally many."""
    place = np.argsort(np.argsort(row, kind="stable"), kind="stable")
    return (place * count // len(row)).astype(np.int64)
