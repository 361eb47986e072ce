"""Generations of a population of programs: scoring, selection, and breeding."""

from collections.abc import Iterable

import numpy as np

from gpmodel.errors import InputError
from gpmodel.evolution.code import Scores
from gpmodel.evolution.pareto import Archive
from gpmodel.evolution.problems import CartesianProblem, Problem
from gpmodel.evolution.representation import Population
from gpmodel.evolution.settings import Settings


class Generations:
    """Successive populations of programs for a search problem, under given settings, without a time limit.

    generation: number of the present population, from 0. archive: programs with the largest gain of all populations.
    """

    def __init__(self, problem: Problem, settings: Settings, rng: np.random.Generator) -> None:
        self.problem, self.selection, self.budget, self.rng = problem, settings.selection, settings.budget, rng
        self.representation = settings.representation
        self.layout = self.representation.layout(problem.inputs, problem.start)
        if isinstance(problem, CartesianProblem) and self.layout.outputs != 3:
            raise InputError(f"outputs: {self.layout.outputs}, a compensator has 3")
        self.fixed = self.layout.fixed_rows(problem.inputs.values)
        self.record, self.archive, self.generation, self.idle = np.inf, Archive(), -1, 0

    @property
    def is_stuck(self) -> bool:
        """True if the score has not improved for so long that a random population replaces the population."""
        return 0 < self.budget.restart_after <= self.idle

    def step(self, guests: Iterable[Population] = ()) -> set[int]:
        """Breed one generation, or begin with a random population, which the programs of ``guests`` join; return the
        complexities of programs that are new in the archive."""
        if self.generation < 0 or self.is_stuck:
            self.idle, self.record = 0, np.inf
            self.population, self.scores = self.start()
            for guest in guests:
                self.population, self.scores = self.population.join(guest), self.scores.join(self.scored(guest))
        else:
            self.population, self.scores = self.next_generation(self.population, self.scores)
        self.generation += 1
        best = float(self.scores.score.min())
        self.idle = 0 if best < self.record - 1e-9 * abs(self.record) or self.record == np.inf else self.idle + 1
        self.record = min(self.record, best)
        return self.archive.add(self.population, self.scores)

    def scored(self, population: Population, known: Scores | None = None) -> Scores:
        """Return the scores of a population of programs; scores of effective code in ``known`` are reused."""
        found = Scores.empty(len(population))
        order = None if known is None else np.argsort(known.hashes)

        for begin in range(0, len(population), self.problem.slice):
            part = slice(begin, begin + self.problem.slice)
            code = population.decoded(self.layout, part)
            if known is None or order is None:
                found.fill(part, self.problem.scores(code, self.fixed))
                continue
            same = order[np.minimum(np.searchsorted(known.hashes, code.hashes, sorter=order), len(order) - 1)]
            met = known.hashes[same] == code.hashes
            old, new = np.flatnonzero(met), np.flatnonzero(~met)
            found.fill(begin + old, known.take(same[old]))
            if len(new):
                found.fill(begin + new, self.problem.scores(code.take(new), self.fixed))

        return found

    def start(self) -> tuple[Population, Scores]:
        """Return a random population of programs and its scores."""
        population = self.representation.initial(self.layout, self.budget.population, self.rng)
        return population, self.scored(population)

    def next_generation(self, population: Population, scores: Scores) -> tuple[Population, Scores]:
        """Breed the next population of programs; return the population and its scores."""
        mothers, fathers = self.selection.parents(scores, self.rng)
        children = self.representation.offspring(self.layout, population, mothers, fathers, self.rng)
        found = self.scored(children, scores)
        both = scores.join(found)
        keep = self.selection.survivors(both, self.budget.population)
        return (children, found) if keep is None else (population.join(children).take(keep), both.take(keep))
