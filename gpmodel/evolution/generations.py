"""One generation after another: scores, selection, breeding, and constants fitted now and then."""

from functools import reduce
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.evolution.constants import own_constants_polished
from gpmodel.evolution.engine import BLOCK, decode
from gpmodel.evolution.linear import SequenceBreeding
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.pareto import Population, program_at
from gpmodel.evolution.problems import COORDINATES, CartesianProblem, Problem
from gpmodel.evolution.scoring import Scores
from gpmodel.evolution.settings import Settings
from gpmodel.evolution.threads import cores, over_slices
from gpmodel.formula.operators import operator_set

POLISHED = 4
"""Programs whose constants are fitted at a time."""


class Breeding(Protocol):
    """How a representation starts and varies."""

    def initial(self, population: int, rng: np.random.Generator) -> Any: ...

    def offspring(
        self, parents: Any, mothers: NDArray[np.intp], fathers: NDArray[np.intp], rng: np.random.Generator
    ) -> Any: ...


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


class Generations:
    """A problem's populations under some settings, without a clock."""

    def __init__(self, problem: Problem, settings: Settings, rng: np.random.Generator) -> None:
        self.problem, self.settings, self.rng = problem, settings, rng
        self.layout = layout_of(problem, settings)
        self.fixed = self.layout.fixed_rows(problem.inputs.values)
        self.threads = settings.threads or cores()
        self.columns = problem.inputs.mapping()
        self.fitted: set[int] = set()
        self.hopeless = np.inf
        self.breeding: Breeding
        if settings.representation == "linear":
            self.breeding = SequenceBreeding(
                self.layout, settings.length, settings.crossover, settings.mutation, self.threads
            )
        else:
            from gpmodel.evolution.tree import TreeBreeding

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

    def start(self) -> tuple[Any, Scores]:
        """A fresh population and its scores."""
        population = self.breeding.initial(self.settings.population, self.rng)
        return population, self.scores(population)

    def following(self, population: Any, scores: Scores) -> tuple[Any, Scores]:
        """The next population and its scores, by truncation or by tournament."""
        settings, rng = self.settings, self.rng
        count = settings.population
        if settings.selection == "truncation":
            few = max(2, int(settings.selected * count))
            elite = np.argpartition(scores.score, few - 1)[:few]
            elite = elite[np.argsort(scores.score[elite], kind="stable")]
            mothers, fathers = rng.choice(elite, (2, count))
            children = self.breeding.offspring(population, mothers, fathers, rng)
            return children, self.scores_of_selectable(children, few)
        entrants = rng.integers(0, count, (2, count, settings.tournament))
        winners = np.take_along_axis(entrants, scores.score[entrants].argmin(axis=2)[..., None], axis=2)[..., 0]
        children = self.breeding.offspring(population, winners[0], winners[1], rng)
        both = scores.join(self.scores(children, known=scores))
        keep = survivors(both, count, settings.keep_distinct)
        return population.join(children).take(keep), both.take(keep)

    def scores_of_selectable(self, children: Any, few: int) -> Scores:
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

    def polished(self, population: Population, scores: Scores) -> tuple[Population, Scores]:
        """The best programs not met before, their constants fitted, in the place of the worst."""
        if isinstance(self.problem, CartesianProblem) or not self.settings.own_constants:
            return population, scores
        order = np.argsort(scores.score, kind="stable")
        fresh = [row for row in order[:64].tolist() if int(scores.hashes[row]) not in self.fitted]
        added: list[Population] = []
        for row in fresh[:POLISHED]:
            self.fitted.add(int(scores.hashes[row]))
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
        self.fitted.update(found.hashes.tolist())
        keep = order[: len(order) - len(children)]
        return population.take(keep).join(children), scores.take(keep).join(found)


def distinct(hashes: NDArray[np.uint64]) -> int:
    """Number of different effective codes."""
    ordered = np.sort(hashes)
    return 1 + int(np.count_nonzero(ordered[1:] != ordered[:-1]))


def survivors(scores: Scores, count: int, keep_distinct: bool = True) -> NDArray[np.intp]:
    """The best ``count`` rows; with ``keep_distinct`` those of a score not seen before come first."""
    order = np.argsort(scores.score, kind="stable")
    if not keep_distinct:
        return order[:count]
    behaviour = np.round(scores.score[order], 9)
    fresh = np.concatenate([[True], (behaviour[1:] != behaviour[:-1])])
    return np.concatenate([order[fresh], order[~fresh]])[:count]
