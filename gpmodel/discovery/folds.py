"""The whole choice on all poses, and its errors from repetitions of it, each without a part of them.

Of few poses a share held out for good costs what it proves. Here every pose is held out once: what is found is chosen
on all poses, and how well such a choice predicts is asked of those made without each fold. Source: Stone (1974),
cross-validatory choice and assessment.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.discovery.result import Discovery
from gpmodel.discovery.rows import drop_duplicate_rows
from gpmodel.errors import InputError
from gpmodel.evidence.confirmation import paired
from gpmodel.evidence.criteria import Criteria
from gpmodel.forks import Forks, called_beside
from gpmodel.model.error_model import Poses
from gpmodel.progress import Teller, silent
from gpmodel.table.bundles import bundles
from gpmodel.table.split import JUDGED, folds

Loop = Callable[[Poses, IntArray, IntArray], Discovery]
"""The whole loop with all its settings, for poses of which some rows train and others are held out."""


def discover_by_folds(
    whole: Loop, again: Loop, poses: Poses, count: int, criteria: Criteria, workers: Forks
) -> Discovery:
    """Run the whole loop on all poses, then once `again` without each of `count` folds of them, whole bundles.

    The errors of each step are those of the poses held out, as the choice without them predicts them: of a fold that
    found less, its last model stands for further steps. again: may leave the evolution out, which makes the errors
    larger than those of such a choice, not smaller. workers: of the repetitions, made while the whole choice is.
    Raises InputError for fewer than two folds, or more than there are bundles of poses.
    """
    started = time.monotonic()
    nothing = np.zeros(0, dtype=np.int64)
    poses, everything, _ = drop_duplicate_rows(poses, np.arange(len(poses)), nothing, Teller(silent))
    units = int(bundles(poses.dataset).max()) + 1
    if not 2 <= count <= units:
        raise InputError(f"{count}, expected 2 to {units}, the groups of poses there are", "folds")
    fold = folds(poses.dataset, count, np.random.default_rng(JUDGED))

    def without(k: int) -> Discovery:
        return again(poses, np.flatnonzero(fold != k), np.flatnonzero(fold == k))

    alone = partial(whole, poses, everything, nothing)
    found, choices = called_beside(workers, alone, [partial(without, k) for k in range(count)])
    steps = tuple(
        replace(step, heldout_error=_errors(poses, choices, number)) for number, step in enumerate(found.steps)
    )
    standard, last = steps[1].heldout_error, steps[-1].heldout_error
    doubt = paired(standard, last, poses.dataset, criteria) if found.findings else None
    final = found.final if doubt is None or doubt.passed else steps[1].calibration
    seconds = time.monotonic() - started
    return replace(
        found, heldout=everything, steps=steps, confirmation=doubt, final=final, parts=tuple(choices), seconds=seconds
    )


def _errors(poses: Poses, parts: Sequence[Discovery], number: int) -> Array:
    """Error (N,) of each pose by the model of step `number` of the choice without it; NaN where there is none."""
    out = np.full(len(poses), np.nan)
    for part in parts:
        held = np.isin(poses.dataset.row, part.poses.dataset.row[part.heldout])
        out[held] = part.step(number).heldout_error
    return out
