"""Rows that a search may use: each measurement once, no held-out pose of a set-up or tool it is not trained on, and
of many a sample to choose on."""

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.comparison import known_rows
from gpmodel.errors import InputError
from gpmodel.model.error_model import Poses
from gpmodel.progress import Teller
from gpmodel.table.bundles import copies, sharing
from gpmodel.table.split import JUDGED

Division = tuple[Poses, IntArray, IntArray]
"""Poses, and which of them train and are held out."""


def usable_rows(poses: Poses, train: IntArray, heldout: IntArray, say: Teller) -> Division:
    """The rows that a search may use. Raises InputError where no held-out pose is of a set-up and tool trained on."""
    poses, train, heldout = drop_duplicate_rows(poses, train, heldout, say)
    if not len(heldout):
        return poses, train, heldout
    data = poses.dataset
    known = heldout[known_rows(data.subset(train), data.subset(heldout))]
    if not len(known):
        raise InputError(
            f"{data.source}: every held-out pose is of a set-up or tool that no training pose is of; expected groups "
            "of poses that lie within set-ups and tools, or another share to hold out"
        )
    if len(known) == len(heldout):
        return poses, train, heldout
    say(f"{len(heldout) - len(known)} held-out poses are of a set-up or tool that no training pose is of: left out")
    return _only(poses, train, known)


def drop_duplicate_rows(poses: Poses, train: IntArray, heldout: IntArray, say: Teller) -> Division:
    """The poses without rows that copy another, which would count twice, and the rows again."""
    copied = copies(poses.dataset)
    if not copied.any():
        return poses, train, heldout
    say(f"{copied.sum()} rows copy the measurement of another to the last digit: left out")
    return _only(poses, train[~copied[train]], heldout[~copied[heldout]])


def evenly(poses: Poses, rows: IntArray, size: int) -> IntArray:
    """About `size` of rows (R,): of every stretch of poses one, drawn at random, with its repeats. All of them where a
    third or less would be left out: what is seen on all is worth more than that time.

    Every k-th pose would be of one value of a joint where a programme steps through a grid.
    """
    if 2 * len(rows) <= 3 * size:
        return rows
    bundle = sharing(poses.subset(rows).dataset)
    count = int(bundle.max()) + 1
    stretch = np.arange(count) * size // len(rows)
    drawn = np.lexsort((np.random.default_rng(JUDGED).random(count), stretch))
    return rows[np.isin(bundle, drawn[np.unique(stretch, return_index=True)[1]])]


def _only(poses: Poses, train: IntArray, heldout: IntArray) -> Division:
    """The poses of some rows, and these again."""
    kept = np.sort(np.concatenate([train, heldout]))
    return poses.subset(kept), np.searchsorted(kept, train), np.searchsorted(kept, heldout)
