"""The Pareto front of genetic programming: at every complexity, the program that removes most of the residual."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from operator import le

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.code import Scores
from gpmodel.evolution.description_length import gain_nats
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.problems import CartesianProblem, Problem, SlotProblem
from gpmodel.evolution.representation import Population, program_of
from gpmodel.formula.expression import parse
from gpmodel.formula.program import Program


@dataclass(frozen=True)
class Solution:
    """An evolved program, its site, and its gain.

    gain: share of the residual sum of squares (effect at a site) or of the norm (compensator) that the program removes.
    coefficients: factors of the program's outputs (ones for a compensator).
    generation: generation in which a formula was bred, 0 for a founder (first formula).
    """

    program: Program
    site: int
    site_name: str
    gain: float
    coefficients: Array
    complexity: int
    generation: int = 0


@dataclass(frozen=True)
class Elite:
    """An evolved program as a population of one.
    gain: largest gain of the program, reached at ``site`` with the outputs in the bit set ``chosen``."""

    population: Population
    gain: float
    chosen: int
    site: int


class Archive:
    """Store of the evolved program that removes the largest share of the residual, for each complexity."""

    def __init__(self) -> None:
        self.best_gain = 0.0
        self.kept: dict[int, Elite] = {}

    def add(self, population: Population, scores: Scores) -> set[int]:
        """Add programs whose gain exceeds that of the stored program of their complexity; return the complexities of
        the added programs."""
        largest, improved = int(scores.complexity.max(initial=0)), set()
        known = np.array([self.kept[k].gain if k in self.kept else 0.0 for k in range(largest + 1)])
        nats = gain_nats(scores.gain)
        better = np.flatnonzero(nats > gain_nats(known)[scores.complexity])
        for row in better[np.argsort(nats[better], kind="stable")].tolist():
            size, gain = int(scores.complexity[row]), float(scores.gain[row])
            found = population.take(np.array([row]))
            self.kept[size] = Elite(found, gain, int(scores.chosen[row]), int(scores.site[row]))
            self.best_gain = max(self.best_gain, gain)
            improved.add(size)
        return improved

    def front(self, problem: Problem, layout: Layout) -> tuple[Solution, ...]:
        """Return the solutions with a larger gain than all simpler solutions, simplest first."""
        found = []
        for _, one in sorted(self.kept.items()):
            outputs = [k for k in range(layout.outputs) if one.chosen >> k & 1]
            found.append(scored(program_of(one.population, 0, layout).select(outputs), problem, one.site))
        nothing = "x, y, z" if isinstance(problem, CartesianProblem) else "0"
        return pareto(found) or (scored(parse(nothing), problem),)


def best_of(front: tuple[Solution, ...], problem: Problem) -> Solution:
    """Return the solution with the least description length (effect at a site) or the largest gain (compensator)."""
    if isinstance(problem, CartesianProblem):
        return max(front, key=lambda solution: solution.gain)
    return min(front, key=lambda solution: description_length(solution, problem))


def pareto(
    solutions: Iterable[Solution], sizes: Callable[[Solution], tuple[int, ...]] = lambda one: (one.complexity,)
) -> tuple[Solution, ...]:
    """Return the solutions with a larger gain than all simpler solutions, simplest first. sizes: measures of
    complexity. A solution is simpler than another if no measure is larger."""
    measured = ((sizes(one), float(gain_nats(one.gain)), one) for one in solutions)
    found: list[tuple[tuple[int, ...], float, Solution]] = []
    for size, nats, solution in sorted(measured, key=lambda one: (one[0], -one[1])):
        if all(nats > other for small, other, _ in found if all(map(le, small, size))):
            found.append((size, nats, solution))
    return tuple(solution for _, _, solution in found)


def description_length(solution: Solution, problem: SlotProblem) -> float:
    """Return the description length of a solution at a site, nats, with the penalty of its nodes and coefficients."""
    return -float(problem.nats(solution.gain, solution.complexity + len(solution.coefficients)))


def scored(program: Program, problem: Problem, site: int = 0) -> Solution:
    """Return a program as a solution of a problem at a site, with its gain and coefficients.

    At a site all outputs are solved together (``Targets.set_gain``). A compensator has coefficients of one, and its
    gain follows from the distances to the measured points. Raises InputError if the program uses an unknown input.
    """
    values = program.evaluate(problem.inputs.mapping())
    if isinstance(problem, CartesianProblem):
        initial = problem.initial_norm
        gain = 1.0 - problem.norm_of(values) / initial if len(values) else 0.0
        return Solution(program, 0, "tip", gain, np.ones(len(values)), program.complexity)
    targets = problem.targets
    gain, coefficients = targets.set_gain(values, site)
    return Solution(program, site, targets.names[site], gain, coefficients, program.complexity)
