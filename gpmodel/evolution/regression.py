"""Symbolic regression: the law of a response over inputs, searched under several links side by side."""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.evolution.constants import polish
from gpmodel.evolution.island import EXACT, Island
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.linked_problem import PRICE, LinkedProblem
from gpmodel.evolution.linked_solution import solved
from gpmodel.evolution.links import LINKS
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.projection import ROUNDING_SHARE, Targets, regression
from gpmodel.evolution.representation import Population
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Builder, Program

NEGLIGIBLE = 1e-9
"""Relative difference from a whole number that is rounding of a solved coefficient."""

FINISHING, POLISHED = 0.1, 12
"""Share of the time that is kept to climb from the best laws and to fit the constants of the best, so many."""

CLIMBED = 0.2
"""Share of the time that may go into climbing."""

SEQUENCES = Linear(operators="physics", constants=(1.0, 2.0, np.pi), own_constants=1, outputs=4, registers=6)
"""What regression evolves."""


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

    Description length: N / 2 ln(share of the variance left) + PRICE (nodes + constants). One population a link
    (``gpmodel.evolution.links``), a generation each in turn. The best of a population that is stuck is climbed from
    before a fresh one takes its place, which the best of the other links join. Raises InputError where the response is
    constant or holds a number that is not finite.
    """
    regression(response)
    began = clock()
    columns = inputs.mapping()
    response = np.asarray(response, dtype=float)
    islands: list[Island] = []
    found = _judged((parse(repr(name)) for name in inputs.names), columns, response)
    for link in LINKS:
        if link.applies(response):
            island = Island(LinkedProblem(inputs, response, link), SEQUENCES, rng)
            sums = solved(island.problem.always, link, columns, response, PRICE)
            found += [] if sums is None else _judged([sums], columns, response)
            islands.append(island)
    climbing = 0.0
    while (now := clock() - began) < (1.0 - FINISHING) * seconds and not any(law.left < EXACT for law in found):
        for island in islands:
            guests: list[Population] = []
            if island.is_stuck:
                guests = [guest for other in islands if other is not island for guest in other.guests()]
                if climbing <= CLIMBED * now:
                    start = clock()
                    found += _judged(island.climbed(), columns, response)
                    climbing += clock() - start
            found += _judged(island.step(guests), columns, response)
    if not any(law.left < EXACT for law in found):
        laws = [_judged(island.laws(), columns, response) for island in islands]
        least = [min((law.nats for law in some), default=np.inf) for some in laws]
        found += chain.from_iterable(laws)
        for k in np.argsort(least).tolist():
            if clock() - began < (1.0 - FINISHING / 2) * seconds:
                found += _judged(islands[k].climbed_from_best(), columns, response)
        best = sorted(found, key=lambda law: law.nats)[:POLISHED]
        found += _judged(_polished(best, columns, response, SEQUENCES.constants), columns, response)
    if not found:
        raise InputError("regress: no program is finite on these inputs")
    return _front(found)


def _front(laws: Iterable[Law]) -> tuple[Law, ...]:
    """The laws that leave less than every one that is no longer."""
    out: list[Law] = []
    for law in sorted(laws, key=lambda law: (law.length, law.left)):
        if not out or law.left < out[-1].left:
            out.append(law)
    return tuple(out)


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
        law = Law(scaled, left, 0.5 * len(response) * float(np.log(max(left, EXACT))))
        laws.append(replace(law, nats=law.nats + PRICE * law.length))
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
        node = builder.apply("multiply", builder.constant(float(round(factor)) if whole else factor), node)
    return builder.program([node])
