"""A population under one link, the best program of each size that it has seen, and laws made of them."""

from collections.abc import Iterable, Iterator

import numpy as np

from gpmodel.evolution.building_blocks import Vocabulary
from gpmodel.evolution.description_length import fit_nats
from gpmodel.evolution.generations import Generations
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.linked_problem import PRICE, LinkedProblem
from gpmodel.evolution.linked_terms import climbed_terms
from gpmodel.evolution.links import LinkTerm
from gpmodel.evolution.pareto import Archive, Elite
from gpmodel.evolution.representation import Population
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.formula.program import Program

EXACT = 1e-20
"""Share of the response's variance below which a law is taken for exact: rounding leaves about 1e-28."""

PROMISING = 1.0 - 1e-7
"""Gain of a program whose law is looked at at once."""

BUDGET = Budget(population=512, restart_after=40, polish_every=0, threads=1)
"""The effort of one population."""


class Island:
    """A population under one link, and the best program of each size that it has seen."""

    def __init__(self, problem: LinkedProblem, representation: Linear, rng: np.random.Generator) -> None:
        self.problem = problem
        self.run = Generations(problem, Settings(representation, budget=BUDGET), rng)
        self.words = Vocabulary(problem.inputs, self.run.layout.operators, representation.constants)
        self.population, self.scores = self.run.start()
        self.archive = Archive()
        self.climbed_from: set[tuple[LinkTerm, ...]] = set()
        self.record = np.inf
        self.idle = 0

    @property
    def is_stuck(self) -> bool:
        """Whether nothing has improved for so long that the next population is a fresh one."""
        return self.idle >= self.run.budget.restart_after

    def step(self, guests: Iterable[Population] = ()) -> Iterator[Program]:
        """One generation, or where this one is stuck a fresh population, which guests join; new laws perhaps exact."""
        if self.is_stuck:
            self.idle, self.record = 0, np.inf
            self.population, self.scores = self.run.start()
            for guest in guests:
                self.population, self.scores = self.population.join(guest), self.scores.join(self.run.scores(guest))
        else:
            self.population, self.scores = self.run.following(self.population, self.scores)
        best = float(self.scores.score.min())
        self.idle = 0 if best < self.record - 1e-9 * abs(self.record) or self.record == np.inf else self.idle + 1
        self.record = min(self.record, best)
        improved = self.archive.add(self.population, self.scores)
        return self._laws({size for size in improved if self.archive.kept[size].gain > PROMISING})

    def laws(self) -> Iterator[Program]:
        """Laws of all programs kept, the largest gain first."""
        return self._laws(self.archive.kept)

    def _laws(self, sizes: Iterable[int]) -> Iterator[Program]:
        for one in sorted((self.archive.kept[size] for size in sizes), key=lambda one: -one.gain):
            law = self.problem.law(self._terms(one.population, one.chosen))
            if law is not None:
                yield law

    def climbed(self) -> Iterator[Program]:
        """The law at the top of the hill on which the population's best stands, where none was climbed from there."""
        best = int(self.scores.score.argmin())
        return self._climbed(self.population.take(np.array([best])), int(self.scores.chosen[best]))

    def climbed_from_best(self) -> Iterator[Program]:
        """Law at the top of the hill of the program of least description length."""
        for one in self._best():
            yield from self._climbed(one.population, one.chosen)

    def guests(self) -> list[Population]:
        """The program of least description length, for other islands; none where none was kept."""
        return [one.population for one in self._best()]

    def _best(self) -> list[Elite]:
        kept = self.archive.kept

        def nats(size: int) -> float:
            gained = float(fit_nats(kept[size].gain, len(self.problem.response), EXACT))
            return gained - PRICE * (size + kept[size].chosen.bit_count())

        return [kept[max(kept, key=nats)]] if kept else []

    def _terms(self, population: Population, chosen: int) -> list[LinkTerm]:
        return self.problem.terms(population.program(0, self.run.layout), chosen)

    def _climbed(self, population: Population, chosen: int) -> Iterator[Program]:
        terms = self._terms(population, chosen)
        start = tuple(terms)
        if terms and start not in self.climbed_from:
            self.climbed_from.add(start)
            law = self.problem.law(climbed_terms(self.problem, terms, self.words))
            if law is not None:
                yield law
