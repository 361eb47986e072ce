"""Formulas of any table: programs bred under links of the response, and the best of them as founders.

Under every link (``gpmodel.evolution.links``) a population of linear sequences is bred, four outputs of each solved
together. The formulas that the links make of the best are founders of one population of formulas of the response
itself (``gpmodel.evolution.memetic``).
"""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.evolution.founders import joined
from gpmodel.evolution.generations import Generations
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.links import LINKS, PRICE, Link, exactly
from gpmodel.evolution.memetic import Formulas, bred
from gpmodel.evolution.pareto import Archive, program_at
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import ROUNDING_SHARE, Targets, regression
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Program

EXACT = 1e-20
"""Share of the response's variance below which a formula is taken for exact: rounding leaves about 1e-28."""
PROMISING = 1.0 - 1e-7
"""Gain of a program whose formula is looked at once it is found."""
FINISHING, FOUNDERS = 0.15, 12
"""Share of the time that is kept to breed the best formulas; so many of them."""
SEQUENCES = Linear(operators="physics", constants=(1.0, 2.0, np.pi), own_constants=1, outputs=4, registers=6)
BUDGET = Budget(population=512, restart_after=40, polish_every=0, threads=1)
"""What is bred under a link, and the effort of one population."""


@dataclass(frozen=True)
class Law:
    """A one-output program for a response, the share of the variance that it leaves, and its description length."""

    program: Program
    left: float
    nats: float

    @property
    def length(self) -> int:
        """Nodes and constants, what a law's text costs."""
        return self.program.complexity + len(self.program.constants)


def regression_front(
    inputs: Inputs,
    response: Array,
    rng: np.random.Generator,
    seconds: float = 5.0,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[Law, ...]:
    """Laws of a response (N,) that no shorter one fits as well, shortest first; ends with the first exact one, or after
    ``seconds``.

    Description length: N / 2 ln(share of the variance left) + PRICE (nodes + constants). Every link has a generation in
    turn; a population that is stuck gives way to a fresh one. Raises InputError where the response is constant or holds
    a number that is not finite.
    """
    regression(response)
    began, columns = clock(), inputs.mapping()
    response = np.asarray(response, dtype=float)
    found = list(_judged((parse(repr(name)) for name in inputs.names), columns, response))
    islands = [_Island(inputs, response, link, rng) for link in LINKS if link.applies(response)]
    for island in islands:
        found += _judged(island.formulas([[]]), columns, response)
    while clock() - began < (1.0 - FINISHING) * seconds and not _exact(found):
        for island in islands:
            found += _judged(island.step(), columns, response)
    if not _exact(found):
        for island in islands:
            found += _judged(island.every(), columns, response)
        found += _judged(_finished(found, inputs, response), columns, response)
    if not found:
        raise InputError("regress: no program is finite on these inputs")
    front: list[Law] = []
    for law in sorted(found, key=lambda law: (law.length, law.left)):
        if not front or law.left < front[-1].left:
            front.append(law)
    return tuple(front)


def _exact(laws: Iterable[Law]) -> bool:
    return any(law.left < EXACT for law in laws)


class _Island:
    """A population under one link, and the best program of each size that it has seen."""

    def __init__(self, inputs: Inputs, response: Array, link: Link, rng: np.random.Generator) -> None:
        self.link, self.columns, self.response = link, inputs.mapping(), response
        problem = SlotProblem(inputs, link.targets(self.columns, response), parsimony=PRICE)
        self.run = Generations(problem, Settings(SEQUENCES, budget=BUDGET), rng)
        self.population, self.scores = self.run.start()
        self.archive, self.record, self.idle = Archive(), np.inf, 0

    def step(self) -> Iterator[Program]:
        """Breed one generation, or begin anew; formulas that may be exact."""
        if self.idle >= BUDGET.restart_after:
            self.idle, self.record = 0, np.inf
            self.population, self.scores = self.run.start()
        else:
            self.population, self.scores = self.run.following(self.population, self.scores)
        best = float(self.scores.score.min())
        self.idle = 0 if best < self.record - 1e-9 * abs(self.record) or self.record == np.inf else self.idle + 1
        self.record = min(self.record, best)
        improved = self.archive.add(self.population, self.scores)
        return self._of_sizes(size for size in improved if self.archive.kept[size].gain > PROMISING)

    def every(self) -> Iterator[Program]:
        """Formulas of all programs kept."""
        return self._of_sizes(self.archive.kept)

    def _of_sizes(self, sizes: Iterable[int]) -> Iterator[Program]:
        kept = [self.archive.kept[size] for size in sizes]
        programs = [program_at(one.population, 0, one.chosen, self.run.layout) for one in kept]
        return self.formulas([one.select([k]) for k in range(len(one.outputs))] for one in programs)

    def formulas(self, sets: Iterable[list[Program]]) -> Iterator[Program]:
        """The formula of each set of terms, where there is one."""
        for terms in sets:
            formula = self.link.formula(terms, self.columns, self.response)
            if formula is not None:
                yield formula


def _finished(laws: Iterable[Law], inputs: Inputs, response: Array) -> Iterator[Program]:
    """Formulas bred from the shortest descriptions, their constants fitted to the response itself."""
    ones, nothing = np.ones((1, len(response))), np.zeros((1, 1, len(response)))
    energy = float(response @ response)
    plain = Targets(ones, nothing, response[None], energy, ("response",), len(response), ROUNDING_SHARE)
    population = Formulas(SlotProblem(inputs, plain, parsimony=PRICE))
    population.add(law.program for law in sorted(laws, key=lambda law: law.nats)[:FOUNDERS])
    bred(population, inputs.names)
    return (one.program for one in population.found)


def _judged(programs: Iterable[Program], columns: dict[str, Array], response: Array) -> Iterator[Law]:
    """Programs as laws, times the factor that fits best, with what they leave of the response; the finite ones."""
    variance = float(np.sum(np.square(response - response.mean())))
    for program in programs:
        values = program.evaluate(columns)[0]
        with np.errstate(all="ignore"):
            size = float(values @ values)
        if not np.isfinite(size) or size <= 0:
            continue
        factor = float(values @ response) / size
        left = float(np.sum(np.square(response - factor * values))) / variance
        law = Law(_scaled(program, factor), left, 0.5 * len(response) * float(np.log(max(left, EXACT))))
        yield replace(law, nats=law.nats + PRICE * law.length)


def _scaled(program: Program, factor: float) -> Program:
    """The program times a factor, which takes up one that is there; left out where it is 1."""
    root = program.nodes[program.outputs[0]]
    if root.operator == "multiply" and program.nodes[root.arguments[0]].operator == "constant":
        factor *= float(program.nodes[root.arguments[0]].value or 0.0)
        program = replace(program, outputs=(root.arguments[1],)).select([0])
    number = exactly(factor)
    return program if number.constants == (1.0,) else joined("multiply", number, program)
