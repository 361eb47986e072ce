"""Run the whole search on all poses, and measure its errors by repeating the search without each fold.

With few poses, a fixed set of held-out poses costs more accuracy than the set proves. Therefore each pose is held out
once: the findings come from all poses, and the errors from repetitions of the search without each fold. Source: Stone
(1974), cross-validatory choice and assessment of statistical predictions.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.discovery.state import Discovery, drop_duplicate_rows
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import paired
from gpmodel.evidence.residual import independent_blocks
from gpmodel.executor import Forks, called, called_beside
from gpmodel.families.candidate import is_program
from gpmodel.model.error_model import Poses
from gpmodel.progress import Reporter, silent
from gpmodel.table.blocks import FOLD_SEED, folds, repeat_blocks

Loop = Callable[[Poses, IntArray, IntArray], Discovery]
"""Type of the whole search with its settings: a function of poses, training rows and held-out rows."""


def discover_by_folds(
    whole: Loop, repeats: Sequence[Loop], poses: Poses, count: int, criteria: Criteria, workers: Forks
) -> Discovery:
    """Run the whole search on all poses, then repeat the search without each of `count` folds of whole blocks.

    The error of model k at pose p is that of model k, or of the last model before k, of the search without pose p.
    repeats: functions that run the search again, the quickest first; a search without genetic programming tends to
    overestimate the errors. If one function does not confirm an evolved finding, the next function is tried at half the
    significance level. workers: processes that run the repetitions, by the first function during the search on all
    poses. Raises InputError for fewer than two folds, or more folds than blocks of poses.
    """
    started = time.monotonic()
    nothing = np.zeros(0, dtype=np.int64)
    poses, everything, _ = drop_duplicate_rows(poses, np.arange(len(poses)), nothing, Reporter(silent))
    units = int(repeat_blocks(poses.dataset).max()) + 1
    if not 2 <= count <= units:
        raise InputError(f"{count}, expected 2 to {units}, the number of groups of poses", "folds")
    fold = folds(poses.dataset, count, np.random.default_rng(FOLD_SEED))

    def without(again: Loop, k: int) -> Discovery:
        return again(poses, np.flatnonzero(fold != k), np.flatnonzero(fold == k))

    first, *others = ([partial(without, again, k) for k in range(count)] for again in repeats)
    found, choices = called_beside(workers, partial(whole, poses, everything, nothing), first)
    answer = _repeated(found, choices, criteria)
    for number, tasks in enumerate(others, start=1):
        if answer.confirmed or not any(is_program(finding.candidate.found_by) for finding in found.findings):
            break
        stricter = replace(criteria, confirmation=0.5**number * criteria.confirmation)
        answer = _repeated(found, called(workers, tasks), stricter)
    return replace(answer, seconds=time.monotonic() - started)


def _repeated(found: Discovery, choices: Sequence[Discovery], criteria: Criteria) -> Discovery:
    """Combine a search on all poses with the errors of its repetitions, and state if the errors confirm findings."""
    steps = tuple(
        replace(step, heldout_error=_errors(found.poses, choices, number)) for number, step in enumerate(found.steps)
    )
    standard, last = steps[1].heldout_error, steps[-1].heldout_error
    doubt = (
        paired(standard, last, independent_blocks(found.poses.dataset, criteria), criteria) if found.findings else None
    )
    final = found.final if doubt is None or doubt.passed else steps[1].calibration
    return replace(found, heldout=found.train, steps=steps, confirmation=doubt, final=final, parts=tuple(choices))


def _errors(poses: Poses, parts: Sequence[Discovery], number: int) -> Array:
    """Return the error, m, of model `number` of the search repeated without a pose at that pose; NaN if unknown."""
    out = np.full(len(poses), np.nan)
    for part in parts:
        held = np.isin(poses.dataset.row, part.poses.dataset.row[part.heldout])
        out[held] = part.step(number).heldout_error
    return out
