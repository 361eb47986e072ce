"""The best program seen at every complexity, over a whole run: the Pareto front."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from gpmodel.evolution.machine import Layout
from gpmodel.evolution.population import Sequences
from gpmodel.evolution.problems import CartesianProblem, Problem, SlotProblem
from gpmodel.evolution.scoring import Scores
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Program

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Candidate:
    """A program, where it acts, and what it explains.

    ``gain`` is the share of residual energy (slot) or of the norm (compensator) it removes, ``coefficients``
    multiply its outputs (ones for a compensator), ``validation`` is the gain of the same coefficients on the
    validation poses, where there are any.
    """

    program: Program
    site: int
    site_name: str
    gain: float
    coefficients: Array
    complexity: int
    validation: float | None = None


class Population(Protocol):
    """A population of either representation."""

    def __len__(self) -> int: ...

    def take(self, rows: NDArray[np.intp]) -> Self: ...

    def join(self, other: Self) -> Self: ...

    def constants_of(self, row: int) -> Array: ...

    def with_constants(self, row: int, values: Array) -> Self: ...


class Archive:
    """Keeps, at each complexity, the genome with the largest gain."""

    def __init__(self, problem: Problem, layout: Layout) -> None:
        self.problem, self.layout = problem, layout
        self.best_gain = 0.0
        self._gains = np.zeros(64)
        self._kept: dict[int, tuple[Population, int]] = {}

    def add(self, population: Population, scores: Scores) -> None:
        """Take in the programs that beat what is known at their complexity."""
        largest = int(scores.complexity.max(initial=0))
        if largest >= len(self._gains):
            self._gains = np.concatenate([self._gains, np.zeros(largest + 1 - len(self._gains))])
        better = np.flatnonzero(scores.gain > self._gains[scores.complexity] + 1e-12)
        for row in better[np.argsort(scores.gain[better], kind="stable")].tolist():
            size, gain = int(scores.complexity[row]), float(scores.gain[row])
            self._gains[size] = gain
            self._kept[size] = (population.take(np.array([row])), int(scores.chosen[row]))
            self.best_gain = max(self.best_gain, gain)

    def front(self) -> tuple[Candidate, ...]:
        """Candidates that no simpler one equals in gain, simplest first."""
        return pareto([self._candidate(*self._kept[size]) for size in sorted(self._kept)]) or (self._nothing(),)

    def best(self, front: tuple[Candidate, ...], parsimony: float) -> Candidate:
        """The candidate of least description length (slot) or of largest gain (compensator)."""
        if isinstance(self.problem, CartesianProblem):
            return max(front, key=lambda candidate: candidate.gain)
        problem = self.problem
        return min(front, key=lambda candidate: description_length(candidate, problem, parsimony))

    def _candidate(self, population: Population, chosen: int) -> Candidate:
        return scored(program_at(population, 0, chosen, self.layout), self.problem)

    def _nothing(self) -> Candidate:
        nothing = "x, y, z" if isinstance(self.problem, CartesianProblem) else "0"
        return scored(parse(nothing), self.problem)


def pareto(candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Those that no simpler one equals in gain, simplest first."""
    found: list[Candidate] = []
    for candidate in sorted(candidates, key=lambda c: (c.complexity, -c.gain)):
        if not found or candidate.gain > found[-1].gain + 1e-12:
            found.append(candidate)
    return tuple(found)


def description_length(candidate: Candidate, problem: SlotProblem, parsimony: float) -> float:
    """Nats of a candidate of a slot, less being better; its nodes and its coefficients are paid for."""
    return -float(problem.nats(candidate.gain, candidate.complexity + len(candidate.coefficients), parsimony))


def program_at(population: Any, row: int, chosen: int, layout: Layout) -> Program:
    """One member of a population as a program of the outputs in the bit set ``chosen``."""
    if isinstance(population, Sequences):
        from gpmodel.evolution import linear

        program = linear.program_of(population.genes[row], population.constants[row], layout)
    else:
        from gpmodel.evolution import tree

        program = tree.program_of(population.individuals[row], layout)
    return program.select(k for k in range(layout.outputs) if chosen >> k & 1)


def scored(program: Program, problem: Problem) -> Candidate:
    """A program as a candidate of a problem: its best site, gain and coefficients."""
    values = program.evaluate(problem.inputs.mapping())
    if isinstance(problem, CartesianProblem):
        initial = problem.initial_norm()
        gain = 1.0 - problem.norm_of(values) / initial if len(values) else 0.0
        return Candidate(program, 0, "tip", gain, np.ones(len(values)), program.complexity)
    targets = problem.targets
    solved = [targets.set_gain(values, site) for site in range(targets.sites)]
    site = int(np.argmax([gain for gain, _ in solved]))
    gain, coefficients = solved[site]
    validation = None
    if problem.validation is not None and problem.validation_inputs is not None and len(values):
        held_out = program.evaluate(problem.validation_inputs.mapping())
        validation = problem.validation.gain_of(held_out, coefficients, site)
    return Candidate(program, site, targets.names[site], gain, coefficients, program.complexity, validation)
