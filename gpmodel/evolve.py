"""The evolutionary search: one loop for both representations and both problems."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gpmodel.archive import Archive, Candidate, Population, program_at
from gpmodel.engine import BLOCK, decode
from gpmodel.errors import InputError
from gpmodel.layout import Layout
from gpmodel.linear import SequenceBreeding
from gpmodel.operators import operator_set
from gpmodel.parallel import cores, over_slices
from gpmodel.polish import own_constants_polished
from gpmodel.problems import COORDINATES, CartesianProblem, Inputs, Problem, SlotProblem
from gpmodel.scoring import Scores
from gpmodel.settings import Settings

__all__ = ["Candidate", "CartesianProblem", "Evolution", "Inputs", "Progress", "Settings", "SlotProblem", "evolve"]

Array = NDArray[np.float64]

POLISHED = 4
"""Programs whose constants are fitted at a time."""


class Breeding(Protocol):
    """How a representation starts and varies."""

    def initial(self, population: int, rng: np.random.Generator) -> Any: ...

    def offspring(
        self, parents: Any, mothers: NDArray[np.intp], fathers: NDArray[np.intp], rng: np.random.Generator
    ) -> Any: ...


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


def layout_of(problem: Problem, settings: Settings) -> Layout:
    """The machine that a problem and settings ask for."""
    inputs = problem.inputs.names
    if isinstance(problem, CartesianProblem):
        if settings.outputs != 3:
            raise InputError(f"outputs: {settings.outputs}, a compensator has 3")
        start: list[str | None] = [*COORDINATES]
    else:
        start = [inputs[k % len(inputs)] for k in range(settings.registers)] if settings.start_inputs else []
    start = (start + [None] * settings.registers)[: max(settings.registers, settings.outputs)]
    return Layout(
        inputs, operator_set(settings.operators), settings.constants, tuple(start), settings.outputs,
        settings.own_constants, settings.direct,
    )  # fmt: skip


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
    return Run(problem, settings, rng).result(progress)


class Run:
    """One search, a generation at a time."""

    def __init__(self, problem: Problem, settings: Settings, rng: np.random.Generator) -> None:
        self.problem, self.settings, self.rng = problem, settings, rng
        self.layout = layout_of(problem, settings)
        self.fixed = self.layout.fixed_rows(problem.inputs.values)
        self.threads = settings.threads or cores()
        self.archive = Archive(problem, self.layout)
        self.columns = problem.inputs.mapping()
        self.polished: set[int] = set()
        self.hopeless = np.inf
        self.breeding: Breeding
        if settings.representation == "linear":
            self.breeding = SequenceBreeding(
                self.layout, settings.length, settings.crossover, settings.mutation, self.threads
            )
        else:
            from gpmodel.tree import TreeBreeding

            self.breeding = TreeBreeding(
                self.layout, settings.breeding, settings.depth, 1, min(4, settings.depth), settings.crossover
            )

    def scores(self, population: Any, hopeless: float = np.inf, known: Scores | None = None) -> Scores:
        """Scores of a population; effective code that is in ``known`` is not run again."""
        readable = getattr(population, "forest", population)
        found = Scores.empty(len(population))
        order = None if known is None else np.argsort(known.hashes)

        def work(part: slice) -> None:
            code = decode(readable, part, self.layout)
            rows = np.arange(part.start, part.stop)
            if known is not None and order is not None:
                place = np.minimum(np.searchsorted(known.hashes, code.hashes, sorter=order), len(order) - 1)
                same = order[place]
                met = known.hashes[same] == code.hashes
                found[rows[met]] = known.take(same[met])
                rows, code = rows[~met], code.take(np.flatnonzero(~met))
            if len(rows):
                found[rows] = self.problem.scores(code, self.fixed, self.settings.parsimony, hopeless)

        over_slices(len(population), self.threads, work, self.problem.slice)
        return found

    def result(self, progress: Callable[[Progress], None] | None) -> Evolution:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1, user_api="blas"):
            return self._search(progress)

    def _search(self, progress: Callable[[Progress], None] | None) -> Evolution:
        settings, rng = self.settings, self.rng
        began = time.perf_counter()
        rows: list[Progress] = []
        evaluations = 0
        population = self.breeding.initial(settings.population, rng)
        scores = self.scores(population)
        if not np.any(np.isfinite(scores.score)):
            raise InputError("evolve: no program of the first population is finite on these inputs")
        generation = 0
        idle, record = 0, np.inf
        while True:
            evaluations += settings.population
            self.archive.add(population, scores)
            seconds = time.perf_counter() - began
            finite = scores.score[np.isfinite(scores.score)]
            best = float(finite.min())
            left = settings.seconds - seconds
            if generation:
                left = min(left, seconds / generation * (settings.generations - generation))
            row = Progress(
                generation, best, float(np.median(finite)), float(self.archive.best_gain),
                distinct(scores.hashes), evaluations / seconds, seconds, max(0.0, left),
            )  # fmt: skip
            rows.append(row)
            if progress:
                progress(row)
            done = generation >= settings.generations or seconds >= settings.seconds
            if done or self.archive.best_gain >= settings.target:
                break
            idle = 0 if best < record - 1e-9 * abs(record) or not np.isfinite(record) else idle + 1
            record = min(record, best)
            generation += 1
            if settings.restart_after and idle >= settings.restart_after:
                population = self.breeding.initial(settings.population, rng)
                scores = self.scores(population)
                idle, record = 0, np.inf
                continue
            population, scores = self._next(population, scores)
            if settings.polish_every and generation % settings.polish_every == 0:
                population, scores = self._polished(population, scores)
        front = self.archive.front()
        chosen = self.archive.best(front, settings.parsimony)
        history = {
            name: np.array([getattr(row, name) for row in rows])
            for name in ("generation", "best", "median", "gain", "distinct", "evaluations_per_second", "seconds")
        }
        return Evolution(
            front, chosen, history, chosen.program.input_counts, chosen.program.operator_counts,
            evaluations, time.perf_counter() - began, settings,
        )  # fmt: skip

    def _next(self, population: Any, scores: Scores) -> tuple[Any, Scores]:
        settings, rng = self.settings, self.rng
        count = settings.population
        if settings.selection == "truncation":
            few = max(2, int(settings.selected * count))
            elite = np.argpartition(scores.score, few - 1)[:few]
            elite = elite[np.argsort(scores.score[elite], kind="stable")]
            mothers, fathers = rng.choice(elite, (2, count))
            children = self.breeding.offspring(population, mothers, fathers, rng)
            return children, self._scores_of_selectable(children, few)
        entrants = rng.integers(0, count, (2, count, settings.tournament))
        winners = np.take_along_axis(entrants, scores.score[entrants].argmin(axis=2)[..., None], axis=2)[..., 0]
        children = self.breeding.offspring(population, winners[0], winners[1], rng)
        both = scores.join(self.scores(children, known=scores))
        keep = survivors(both, count)
        return population.join(children).take(keep), both.take(keep)


    def _scores_of_selectable(self, children: Any, few: int) -> Scores:
        """Scores in which those too bad to be selected may be infinite; who is selected is the same.

        Over many poses, a maximum that passes a limit is not run to the end. Where fewer than ``few`` stay
        below the limit, taken from the generation before, everything is run again without one.
        """
        problem = self.problem
        pays = isinstance(problem, CartesianProblem) and problem.norm == "max" and self.fixed.shape[1] > BLOCK
        if not pays or self.settings.parsimony:
            return self.scores(children)
        found = self.scores(children, self.hopeless)
        if np.count_nonzero(found.score <= self.hopeless) < few:
            found = self.scores(children)
        self.hopeless = float(np.partition(found.score, few - 1)[few - 1])
        return found

    def _polished(self, population: Population, scores: Scores) -> tuple[Population, Scores]:
        """The best programs not met before, their constants fitted, in the place of the worst."""
        if isinstance(self.problem, CartesianProblem) or not self.settings.own_constants:
            return population, scores
        order = np.argsort(scores.score, kind="stable")
        fresh = [row for row in order[:64].tolist() if int(scores.hashes[row]) not in self.polished]
        added: list[Population] = []
        for row in fresh[:POLISHED]:
            self.polished.add(int(scores.hashes[row]))
            program = program_at(population, row, int(scores.chosen[row]), self.layout)
            own = population.constants_of(row)
            fitted = own_constants_polished(
                program, self.problem.targets, int(scores.site[row]), self.columns, own, self.settings.constants
            )
            if not np.array_equal(fitted, own):
                added.append(population.with_constants(row, fitted))
        if not added:
            return population, scores
        children = reduce(lambda left, right: left.join(right), added)
        found = self.scores(children)
        self.polished.update(found.hashes.tolist())
        keep = order[: len(order) - len(children)]
        return population.take(keep).join(children), scores.take(keep).join(found)


def distinct(hashes: NDArray[np.uint64]) -> int:
    """Number of different effective codes."""
    ordered = np.sort(hashes)
    return 1 + int(np.count_nonzero(ordered[1:] != ordered[:-1]))


def survivors(scores: Scores, count: int) -> NDArray[np.intp]:
    """The best ``count`` rows, those of a score not seen before first."""
    order = np.argsort(scores.score, kind="stable")
    behaviour = np.round(scores.score[order], 9)
    fresh = np.concatenate([[True], (behaviour[1:] != behaviour[:-1])])
    return np.concatenate([order[fresh], order[~fresh]])[:count]
