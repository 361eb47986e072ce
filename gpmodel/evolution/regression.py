"""Symbolic regression: the law of a response over inputs, searched under several links side by side."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.evolution.constants import polish
from gpmodel.evolution.generations import Generations
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.linked_problem import PRICE, LinkedProblem
from gpmodel.evolution.links import LINKS, solved
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.projection import ROUNDING_SHARE, Targets, regression
from gpmodel.evolution.representation import Population
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.formula.program import Builder, Program

Array = NDArray[np.float64]

EXACT = 1e-20
"""Share of the response's variance below which a law is taken for exact: rounding leaves about 1e-28."""

PROMISING = 1.0 - 1e-7
"""Gain of a program whose law is looked at at once."""

NEARLY_EXACT = 1e-4
"""Share of a linked response's variance below which its link may be the law's; above, noise rules what is left."""

NEGLIGIBLE = 1e-9
"""Relative difference from a whole number that is rounding of a solved coefficient."""

FINISHING, POLISHED = 0.06, 12
"""Share of the time that is kept for the constants of the best laws, and how many these are."""

ALWAYS_ON, RANKED_EVERY = 2, 20
"""Links that have a generation in every turn, and turns after which they are ranked anew."""

SEQUENCES = Linear(operators="physics", constants=(1.0, 2.0, np.pi), own_constants=1, outputs=4, registers=6)
BUDGET = Budget(population=512, restart_after=40, polish_every=0, threads=1)
"""What regression evolves, and the effort of one population."""


@dataclass(frozen=True)
class Law:
    """A one-output program for a response, the share of the variance that it leaves, and its description length."""

    program: Program
    left: float
    nats: float


class Island:
    """A population under one link, and the best program of each size that it has seen."""

    def __init__(self, problem: LinkedProblem, representation: Linear, rng: np.random.Generator) -> None:
        self.problem = problem
        self.run = Generations(problem, Settings(representation, budget=BUDGET), rng)
        self.population, self.scores = self.run.start()
        self.kept: dict[int, tuple[float, Population, int]] = {}
        self.record = np.inf
        self.left = np.inf
        self.idle = 0

    def step(self) -> Iterator[Program]:
        """One generation, or a fresh population where nothing has improved for long; the new laws that may be exact."""
        best = float(self.scores.score.min())
        self.idle = 0 if best < self.record - 1e-9 * abs(self.record) or self.record == np.inf else self.idle + 1
        self.record = min(self.record, best)
        if self.idle >= self.run.budget.restart_after:
            self.idle, self.record = 0, np.inf
            self.population, self.scores = self.run.start()
        else:
            self.population, self.scores = self.run.following(self.population, self.scores)
        return self._laws({size for size in self._keep() if self.kept[size][0] > PROMISING})

    def _keep(self) -> set[int]:
        """Take in what beats what is known at its size; the sizes."""
        scores, improved = self.scores, set()
        largest = int(scores.complexity.max(initial=0))
        known = np.array([self.kept[k][0] if k in self.kept else 0.0 for k in range(largest + 1)])
        better = np.flatnonzero(scores.gain > known[scores.complexity] + 1e-12)
        for row in better[np.argsort(scores.gain[better], kind="stable")].tolist():
            gain, size = float(scores.gain[row]), int(scores.complexity[row])
            self.kept[size] = gain, self.population.take(np.array([row])), int(scores.chosen[row])
            improved.add(size)
        return improved

    def linked_left(self) -> float:
        """Share of the linked response's variance that its best program leaves; infinite where that says nothing.

        A denominator can shrink any error, and a link's own scale is ruled by the few responses that it spreads.
        """
        best = max((gain for gain, _, _ in self.kept.values()), default=0.0)
        left = self.problem.share * (1.0 - best)
        return np.inf if self.problem.link.quotient or left > NEARLY_EXACT else left

    def laws(self) -> Iterator[Program]:
        """Laws of all programs kept, the largest gain first."""
        return self._laws(self.kept)

    def _laws(self, sizes: Iterable[int]) -> Iterator[Program]:
        for _, population, chosen in sorted((self.kept[size] for size in sizes), key=lambda kept: -kept[0]):
            law = self.problem.law(population.program(0, self.run.layout), chosen)
            if law is not None:
                yield law


def regress(
    inputs: Inputs,
    response: Array,
    rng: np.random.Generator,
    seconds: float = 5.0,
    representation: Linear = SEQUENCES,
    clock: Callable[[], float] = time.perf_counter,
) -> Law:
    """The first law of a response (N,) that is exact, or after ``seconds`` that of least description length.

    Description length: N / 2 ln(share of the variance left) + PRICE (nodes + constants). One population a link
    (``gpmodel.evolution.links``); the two whose laws leave least have a generation in every turn, the others take
    turns. Raises InputError where the response is constant or holds a number that is not finite.
    """
    regression(response)
    began = clock()
    columns = inputs.mapping()
    response = np.asarray(response, dtype=float)
    islands: list[Island] = []
    found: list[Law] = []
    for link in LINKS:
        if link.applies(response):
            island = Island(LinkedProblem(inputs, response, link), representation, rng)
            sums = solved(island.problem.always, link, columns, response, PRICE)
            found += [] if sums is None else _judged([sums], columns, response)
            islands.append(island)
    turn = 1
    while clock() - began < (1.0 - FINISHING) * seconds and not any(law.left < EXACT for law in found):
        for island in _in_turn(islands, turn):
            found += _judged(island.step(), columns, response)
        if turn % RANKED_EVERY == 0:
            for island in islands:
                laws = _judged(islice(island.laws(), 1), columns, response)
                island.left = min([island.left, island.linked_left(), *(law.left for law in laws)])
        turn += 1
    if not any(law.left < EXACT for law in found):
        found += [law for island in islands for law in _judged(island.laws(), columns, response)]
        best = sorted(found, key=lambda law: law.nats)[:POLISHED]
        found += _judged(_polished(best, columns, response, representation.constants), columns, response)
    if not found:
        raise InputError("regress: no program is finite on these inputs")
    return min(found, key=lambda law: law.nats)


def _polished(
    laws: Iterable[Law], columns: dict[str, Array], response: Array, held: tuple[float, ...]
) -> Iterator[Program]:
    """The programs with constants that fit the response itself best: a link weighs its errors otherwise."""
    plain = Targets(
        np.ones((1, len(response))), np.zeros((1, 1, len(response))), response[None], float(response @ response),
        ("response",), len(response), ROUNDING_SHARE,
    )  # fmt: skip
    for law in laws:
        yield polish(law.program, plain, 0, columns, held)[0]


def _in_turn(islands: Sequence[Island], turn: int) -> list[Island]:
    ranked = sorted(islands, key=lambda island: island.left)
    others = ranked[ALWAYS_ON:]
    return [*ranked[:ALWAYS_ON], *(others[turn % len(others) :][:1] if others else [])]


def _judged(programs: Iterable[Program], columns: dict[str, Array], response: Array) -> list[Law]:
    """Programs as laws, times the factor that fits best, with what they leave of the response; the finite ones."""
    laws = []
    variance = float(np.sum(np.square(response - response.mean())))
    for program in programs:
        values = program.evaluate(columns)[0]
        with np.errstate(all="ignore"):
            size = float(values @ values)
        if not np.isfinite(size) or size <= 0:
            continue
        factor = float(values @ response) / size
        rest = response - factor * values
        scaled = _scaled(program, factor)
        left = float(rest @ rest) / variance
        length = scaled.complexity + len(scaled.constants)
        nats = 0.5 * len(response) * float(np.log(max(left, EXACT))) + PRICE * length
        laws.append(Law(scaled, left, nats))
    return laws


def _scaled(program: Program, factor: float) -> Program:
    """The program times a factor, which takes up one that is there; left out where it is 1."""
    builder = Builder()
    copies = builder.copy(program)
    root = program.nodes[program.outputs[0]]
    node = copies[program.outputs[0]]
    if root.operator == "multiply" and program.nodes[root.arguments[0]].operator == "constant":
        factor *= float(program.nodes[root.arguments[0]].value or 0.0)
        node = copies[root.arguments[1]]
    if abs(factor - 1.0) > NEGLIGIBLE:
        whole = abs(factor - round(factor)) < NEGLIGIBLE
        node = builder.apply("multiply", builder.constant(round(factor) if whole else factor), node)
    return builder.program([node])
