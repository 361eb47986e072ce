"""Generations of a population of programs: scoring, selection, breeding, and fits of constants at intervals."""

from functools import reduce

import numpy as np
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.evolution.constants import own_constants_polished
from gpmodel.evolution.engine import over_slices
from gpmodel.evolution.pareto import program_at
from gpmodel.evolution.problems import CartesianProblem, Problem, SlotProblem
from gpmodel.evolution.representation import Population
from gpmodel.evolution.scoring import Scores
from gpmodel.evolution.settings import Settings
from gpmodel.executor import cores

POLISHED = 4
"""Number of programs whose constants are fitted at a time."""


class Generations:
    """Successive populations of programs for a search problem, under given settings, without a time limit."""

    def __init__(self, problem: Problem, settings: Settings, rng: np.random.Generator) -> None:
        self.problem, self.selection, self.budget, self.rng = problem, settings.selection, settings.budget, rng
        self.threads = self.budget.threads or cores()
        self.breeding = settings.representation.breeding(problem.inputs, problem.start, self.threads)
        self.layout = self.breeding.layout
        if isinstance(problem, CartesianProblem) and self.layout.outputs != 3:
            raise InputError(f"outputs: {self.layout.outputs}, a compensator has 3")
        self.fixed = self.layout.fixed_rows(problem.inputs.values)
        self.fitted: set[int] = set()
        self.cutoff = np.inf

    def scores(self, population: Population, cutoff: float = np.inf, known: Scores | None = None) -> Scores:
        """Return the scores of a population of programs; scores of effective code in ``known`` are reused. cutoff:
        limit of the score above which a program may get an infinite score."""
        decode = population.decoder(self.layout)
        found = Scores.empty(len(population))
        order = None if known is None else np.argsort(known.hashes)

        def work(part: slice) -> None:
            code = decode(part)
            if known is None or order is None:
                found[part] = self.problem.scores(code, self.fixed, cutoff)
                return
            same = order[np.minimum(np.searchsorted(known.hashes, code.hashes, sorter=order), len(order) - 1)]
            met = known.hashes[same] == code.hashes
            old, new = np.flatnonzero(met), np.flatnonzero(~met)
            found[part.start + old] = known.take(same[old])
            if len(new):
                found[part.start + new] = self.problem.scores(code.take(new), self.fixed, cutoff)

        over_slices(len(population), self.threads, work, self.problem.slice)
        return found

    def start(self) -> tuple[Population, Scores]:
        """Return a random population of programs and its scores."""
        population = self.breeding.initial(self.budget.population, self.rng)
        return population, self.scores(population)

    def next_generation(self, population: Population, scores: Scores) -> tuple[Population, Scores]:
        """Breed the next population of programs; return the population and its scores."""
        count = self.budget.population
        mothers, fathers = self.selection.parents(scores, self.rng)
        children = self.breeding.offspring(population, mothers, fathers, self.rng)
        few = self.selection.eligible(count)
        early = few < count and isinstance(self.problem, CartesianProblem) and self.problem.can_stop_early
        found = self.scores_of_eligible(children, few) if early else self.scores(children, known=scores)
        both = scores.join(found)
        keep = self.selection.survivors(both, count)
        return (children, found) if keep is None else (population.join(children).take(keep), both.take(keep))

    def scores_of_eligible(self, children: Population, few: int) -> Scores:
        """Return scores in which programs too bad to be selected may be infinite, which does not change the selection.

        Computing the maximum error over many poses stops once the error exceeds a limit, taken from the generation
        before. If fewer than ``few`` programs are below the limit, all programs are scored without it.
        """
        found = self.scores(children, self.cutoff)
        if np.count_nonzero(found.score <= self.cutoff) < few:
            found = self.scores(children)
        self.cutoff = float(np.partition(found.score, few - 1)[few - 1])
        return found

    def polished(self, population: Population, scores: Scores) -> tuple[Population, Scores]:
        """Fit the constants of the best programs not fitted before; the fitted programs replace the worst programs."""
        if not isinstance(self.problem, SlotProblem) or not self.layout.own_constants:
            return population, scores
        columns = self.problem.inputs.mapping()
        order = np.argsort(scores.score, kind="stable")
        fresh = [row for row in order[:64].tolist() if int(scores.hashes[row]) not in self.fitted]
        added: list[Population] = []
        for row in fresh[:POLISHED]:
            self.fitted.add(int(scores.hashes[row]))
            program = program_at(population, row, int(scores.chosen[row]), self.layout)
            own = population.decoder(self.layout)(slice(row, row + 1)).constants[0]
            fitted = own_constants_polished(
                program, self.problem.targets, int(scores.site[row]), columns, own, self.layout.constants
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
    """Return the number of programs with different effective code, from the hashes of their code."""
    ordered = np.sort(hashes)
    return 1 + int(np.count_nonzero(ordered[1:] != ordered[:-1]))
