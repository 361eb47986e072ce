"""Cross-fitting: whether what is evolved without some of the poses predicts those poses."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.discovery.acceptance import Hypothesis
from gpmodel.discovery.explore import Turn, candidates_of, posed, run
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Test, Verdict
from gpmodel.evidence.cross_validation import cross_validated
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import scores
from gpmodel.evidence.sign_flips import sign_flip_chance
from gpmodel.evolution.chance import larger
from gpmodel.evolution.runs import Task
from gpmodel.evolution.settings import Settings
from gpmodel.families.candidate import Candidate
from gpmodel.model.sites import Site
from gpmodel.table.split import folds

FOLDS = 3
"""Two thirds of the poses evolve each time: with fewer a law that is there would not be found."""
RUNS = 2
"""GP runs without each third: a second one finds what the first has missed."""
AFTER = 1000
"""Number of the first of these runs: beyond those of any exploration, so that each is kept as its own."""


def cross_fitted(
    residual: Residual, judged: Sequence[Hypothesis], sites: tuple[Site, ...], search: Search,
    rng: np.random.Generator, turn: Turn,
) -> tuple[Hypothesis, ...]:  # fmt: skip
    """The hypotheses, each without a name that passed with one test more: the chance that structure and coefficient,
    both from other poses, predict poses better than the model without. It is the chance they are told with, where it is
    the larger one.

    The structure of a named effect is the catalogue's: no poses shaped it. The test is of the search, once for all that
    it found; nothing is evolved where nothing passed. Source: Chernozhukov et al. (2018), cross-fitting.
    """
    asked = [h.accepted and not h.candidate.family for h in judged]
    if not any(asked):
        return tuple(judged)
    found = sign_flip_chance(gain_of_search(residual, sites, search, rng, turn))
    limit = residual.criteria.significance
    test = Test("cross-fitting", found.p, limit, found.p < limit)
    return tuple(
        replace(h, verdict=Verdict((*h.verdict.tests, test)), chance=larger(h.chance, found)) if ask else h
        for h, ask in zip(judged, asked, strict=True)
    )


def gain_of_search(
    residual: Residual, sites: tuple[Site, ...], search: Search, rng: np.random.Generator, turn: Turn
) -> Array:
    """What the squared error (U,), m², of independent units of poses falls by with what is evolved, and fitted, without
    them."""
    fold = folds(residual.poses.dataset, FOLDS, rng)
    parts = [np.flatnonzero(fold != k) for k in np.unique(fold)]
    settings = Settings(search.strategies[0], budget=search.budget(turn.opening))
    problems = [posed(residual, sites, search, _sampled(part, search, rng)) for part in parts]
    tasks = [Task(problem, settings, rng.spawn(1)[0]) for problem, _ in problems for _ in range(RUNS)]
    found = run(dict(enumerate(tasks, AFTER)), search, turn)
    split = replace(residual, fold_of_row=fold[residual.problem.pose_of_row])
    fold_of_unit = np.zeros(residual.unit_of_pose.max() + 1, dtype=np.int64)
    fold_of_unit[residual.unit_of_pose] = fold
    gain, before = np.zeros(len(fold_of_unit)), cross_validated(split, ()).per_unit
    for k, (part, question) in enumerate(zip(parts, problems, strict=True)):
        pool = candidates_of(residual, sites, search, question, found[k * RUNS : (k + 1) * RUNS])
        best = _best(residual, part, pool)
        if best is not None:
            after = cross_validated(split, best.effects).per_unit
            gain += np.where(fold_of_unit == k, before - after, 0.0)
    return gain


def _best(residual: Residual, part: IntArray, pool: Sequence[Candidate]) -> Candidate | None:
    """The candidate that saves most on a part of the poses; None where none saves anything."""
    own = residual_of(residual.calibration, residual.poses.subset(part), residual.criteria, 0)
    nats = [score.nats for score in scores(own, pool)]
    best = int(np.argmax(nats)) if nats else -1
    return pool[best] if nats and nats[best] > 0 else None


def _sampled(part: IntArray, search: Search, rng: np.random.Generator) -> IntArray:
    return np.sort(rng.permutation(part)[: search.evolved_poses])
