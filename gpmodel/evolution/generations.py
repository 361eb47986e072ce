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
        self.cutoff, self.record = np.inf, np.inf
        self.archive, self.generation, self.idle = Archive(), -1, 0

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

    def scored(self, population: Population, cutoff: float = np.inf, known: Scores | None = None) -> Scores:
        """Return the scores of a population of programs; scores of effective code in ``known`` are reused. cutoff:
        score above which a program may get an infinite score."""
        found = Scores.empty(len(population))
        order = None if known is None else np.argsort(known.hashes)

        for begin in range(0, len(population), self.problem.slice):
            part = slice(begin, begin + self.problem.slice)
            code = population.decoded(self.layout, part)
            if known is None or order is None:
                found.fill(part, self.problem.scores(code, self.fixed, cutoff))
                continue
            same = order[np.minimum(np.searchsorted(known.hashes, code.hashes, sorter=order), len(order) - 1)]
            met = known.hashes[same] == code.hashes
            old, new = np.flatnonzero(met), np.flatnonzero(~met)
            found.fill(begin + old, known.take(same[old]))
            if len(new):
                found.fill(begin + new, self.problem.scores(code.take(new), self.fixed, cutoff))

        return found

    def start(self) -> tuple[Population, Scores]:
        """Return a random population of programs and its scores."""
        population = self.representation.initial(self.layout, self.budget.population, self.rng)
        return population, self.scored(population)

    def next_generation(self, population: Population, scores: Scores) -> tuple[Population, Scores]:
        """Breed the next population of programs; return the population and its scores."""
        count = self.budget.population
        mothers, fathers = self.selection.parents(scores, self.rng)
        children = self.representation.offspring(self.layout, population, mothers, fathers, self.rng)
        few = self.selection.eligible(count)
        early = few < count and isinstance(self.problem, CartesianProblem) and self.problem.can_stop_early
        found = self.scores_of_eligible(children, few) if early else self.scored(children, known=scores)
        both = scores.join(found)
        keep = self.selection.survivors(both, count)
        return (children, found) if keep is None else (population.join(children).take(keep), both.take(keep))

    def scores_of_eligible(self, children: Population, few: int) -> Scores:
        """Return scores in which programs too bad to be selected may be infinite, which does not change the selection.

        Computing the maximum error over many poses stops once the error exceeds a limit, taken from the generation
        before. If fewer than ``few`` programs are below the limit, all programs are scored without a limit.
        """
        found = self.scored(children, self.cutoff)
        if np.count_nonzero(found.score <= self.cutoff) < few:
            found = self.scored(children)
        self.cutoff = float(np.partition(found.score, few - 1)[few - 1])
        return found
