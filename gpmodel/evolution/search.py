"""The evolutionary search: one loop for both representations and both problems."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.evolution.building_blocks import Vocabulary, promising
from gpmodel.evolution.generations import Generations, distinct
from gpmodel.evolution.hill_climb import climbed
from gpmodel.evolution.pareto import Archive, Candidate, description_length, pareto, scored
from gpmodel.evolution.problems import CartesianProblem, Inputs, Problem, SlotProblem
from gpmodel.evolution.settings import Settings
from gpmodel.formula.operators import Operator

__all__ = ["Candidate", "CartesianProblem", "Evolution", "Inputs", "Progress", "Settings", "SlotProblem", "evolve"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Progress:
    """State of a run after one generation; best and median are scores (lower is better) of finite programs."""

    generation: int
    best: float
    median: float
    gain: float
    distinct: int
    evaluations_per_second: float
    seconds: float
    seconds_left: float


@dataclass(frozen=True)
class Evolution:
    """What a run found.

    ``front`` holds the programs that no other beats in both gain and complexity, simplest first; ``history``
    one array a quantity (generation, best, median, gain, distinct, evaluations_per_second, seconds).
    ``histogram`` counts the inputs that the effective code of the best program references, ``operators`` its
    operators. ``evaluations`` is the number of programs scored.
    """

    front: tuple[Candidate, ...]
    best: Candidate
    history: dict[str, Array]
    histogram: dict[str, int]
    operators: dict[str, int]
    evaluations: int
    seconds: float
    settings: Settings = field(repr=False)


def evolve(
    problem: Problem,
    settings: Settings,
    rng: np.random.Generator,
    progress: Callable[[Progress], None] | None = None,
) -> Evolution:
    """Search until ``settings.generations`` or ``settings.seconds`` is over.

    The result depends on the problem, the settings and the generator only, whatever the number of threads
    (where generations end the run; time ends it where it ends). Raises InputError where no program of the
    first population has a finite score.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        return _search(Generations(problem, settings, rng), progress)


def _search(run: Generations, progress: Callable[[Progress], None] | None) -> Evolution:
    settings = run.settings
    archive = Archive(run.problem, run.layout)
    began = time.perf_counter()
    rows: list[Progress] = []
    evaluations = 0
    population, scores = run.start()
    if not np.any(np.isfinite(scores.score)):
        raise InputError("evolve: no program of the first population is finite on these inputs")
    generation = 0
    idle, record = 0, np.inf
    while True:
        evaluations += settings.population
        archive.add(population, scores)
        seconds = time.perf_counter() - began
        finite = scores.score[np.isfinite(scores.score)]
        best, median = (float(finite.min()), float(np.median(finite))) if len(finite) else (np.inf, np.inf)
        left = settings.seconds - seconds
        if generation:
            left = min(left, seconds / generation * (settings.generations - generation))
        row = Progress(
            generation, best, median, float(archive.best_gain),
            distinct(scores.hashes), evaluations / seconds, seconds, max(0.0, left),
        )  # fmt: skip
        rows.append(row)
        if progress:
            progress(row)
        done = generation >= settings.generations or seconds >= settings.seconds
        if done or archive.best_gain >= settings.target:
            break
        idle = 0 if best < record - 1e-9 * abs(record) or not np.isfinite(record) else idle + 1
        record = min(record, best)
        generation += 1
        if settings.restart_after and idle >= settings.restart_after:
            population, scores = run.start()
            idle, record = 0, np.inf
            continue
        population, scores = run.following(population, scores)
        if settings.polish_every and generation % settings.polish_every == 0:
            population, scores = run.polished(population, scores)
    front = archive.front()
    if settings.climb and isinstance(run.problem, SlotProblem):
        front = _finished(front, run.problem, run.layout.operators, settings)
    chosen = archive.best(front, settings.parsimony)
    history = {
        name: np.array([getattr(row, name) for row in rows])
        for name in ("generation", "best", "median", "gain", "distinct", "evaluations_per_second", "seconds")
    }
    return Evolution(
        front, chosen, history, chosen.program.input_counts, chosen.program.operator_counts,
        evaluations, time.perf_counter() - began, settings,
    )  # fmt: skip


def _finished(
    front: tuple[Candidate, ...], problem: SlotProblem, operators: tuple[Operator, ...], settings: Settings
) -> tuple[Candidate, ...]:
    """The front after its best programs, and the best pairs of elements, were climbed from by single edits."""
    words = Vocabulary(problem.inputs, operators)
    best = sorted(front, key=lambda c: description_length(c, problem, settings.parsimony))[: settings.climb]
    starts = [(c.program, c.site) for c in best]
    starts += promising(problem, words, settings.parsimony, settings.climb)
    tops = [climbed(program, problem, site, words, settings.parsimony) for program, site in starts]
    return pareto([*front, *(scored(top, problem) for top in tops)])
