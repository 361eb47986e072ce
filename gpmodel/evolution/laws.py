"""The law of a response at a known place in one or two known inputs.

Of one input every short shape is looked at (``gpmodel.evolution.shapes``); the best are fitted and climbed from by
single edits. Of two inputs a law is a product of a law of each, or a law of a weighted sum: the factors, or the
weights, are found without a shape, and then each is a search in one input. Constants are fitted to the residual of the
whole model, seen from the place.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

from gpmodel.evolution.building_blocks import Vocabulary, promising
from gpmodel.evolution.constants import polish
from gpmodel.evolution.hill_climb import climbed
from gpmodel.evolution.pareto import Solution, description_length, pareto, scored
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.shapes import shapes
from gpmodel.evolution.smooth import factors, through, weighted_sum
from gpmodel.formula.operators import operator_set
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Builder, Program

STARTED, FITTED, STEPS = 200, 40, 4
"""Shapes whose constants are fitted in a few steps; the best of these, which are fitted to the end; and those steps."""
LONGEST = 30
"""Nodes that a law may have."""
CLIMBED = 3
"""Laws of one input, and pairs of elements, that are climbed from by single edits, the best."""
FACTORS = 6
"""Laws of each factor of a product, the shortest descriptions."""
EVEN = 0.05
"""Weights so far from one at most, whose plain sum or difference is offered too, as of angles in one plane."""


def laws_at(problem: SlotProblem, site: int, names: Sequence[str]) -> tuple[Solution, ...]:
    """Laws of one term at one site in one or two inputs that no shorter one equals in gain, shortest first.

    ``problem.nats(law.gain, law.complexity + 1)`` says what each saves; its coefficient is solved. Depends on the
    arguments only. Raises InputError for an unknown input.
    """
    there = problem.only(site, names)
    there = replace(there, inputs=Inputs(there.inputs.names, there.inputs.values))  # any form of any kind of input
    found = _of_one(there) if len(names) == 1 else _with_fitted(there, [*_products(there), *_of_weighted_sum(there)])
    return tuple(law for law in pareto(found) if 0 < law.complexity <= LONGEST and law.program.inputs)


def _of_one(problem: SlotProblem) -> list[Solution]:
    """Shapes of one input, as they are and fitted, what climbing makes of the best, and what is left of the very best
    without one of its nodes."""
    found = _with_fitted(problem, _shapes(problem))
    words = Vocabulary(problem.inputs, operator_set("slot"))
    best = sorted(found, key=lambda law: description_length(law, problem))
    starts = [law.program for law in best[:CLIMBED]] + [pair for pair, _ in promising(problem, words, CLIMBED)]
    found += _with_fitted(problem, [climbed(start, problem, 0, words, 1) for start in starts])
    top = min(found, key=lambda law: description_length(law, problem))
    return found + _with_fitted(problem, list(_shorter(top.program)))


def _shorter(program: Program) -> Iterator[Program]:
    """The program with one of its nodes given way to one of that node's arguments."""
    for node, argument in [(i, k) for i, left in enumerate(program.nodes) for k in left.arguments]:
        builder, copies = Builder(), list[int]()
        for index, old in enumerate(program.nodes):
            copies.append(copies[argument] if index == node else builder.add(old, copies))
        yield builder.program([copies[output] for output in program.outputs])


def _shapes(problem: SlotProblem) -> list[Program]:
    """One input, and the shapes of it that save most after a few steps of their constants."""
    ((name, column),) = columns = problem.inputs.mapping().items()
    started = [
        polish(shape, problem.targets, 0, dict(columns), steps=STEPS)[0]
        for shape in shapes(name, column, problem.targets, STARTED)
    ]
    started.sort(key=lambda program: description_length(scored(program, problem), problem))
    return [parse(repr(name)), *started[:FITTED]]


def _with_fitted(problem: SlotProblem, programs: Sequence[Program]) -> list[Solution]:
    """Programs as they are, and with fitted constants."""
    columns = problem.inputs.mapping()
    fitted = (polish(program, problem.targets, 0, columns)[0] for program in programs)
    return [scored(program, problem) for program in (*programs, *fitted)]


def _products(problem: SlotProblem) -> list[Program]:
    """Products of a law of each of two inputs, each searched as the problem is seen through the other factor."""
    fronts, inputs = [], problem.inputs
    pair = factors(problem.targets, inputs.values)
    for name, other in zip(inputs.names, pair[::-1], strict=True):
        one = SlotProblem(inputs.select([name]), through(problem.targets, other), parsimony=problem.parsimony)
        laws = laws_at(one, 0, [name])
        fronts.append([law.program for law in sorted(laws, key=lambda law: description_length(law, one))[:FACTORS]])
    product = parse("first*second")
    return [product.with_inputs({"first": f, "second": s}) for f, s in itertools.product(*fronts)]


def _of_weighted_sum(problem: SlotProblem) -> list[Program]:
    """Laws of the weighted sum of two inputs that says most, and of the plain one beside it."""
    first, second = weighted_sum(problem.targets, problem.inputs.values)
    (one, other), weight = (repr(name) for name in problem.inputs.names), second / first
    text = f"{one} + ({weight:.6g})*{other}" if abs(weight) < 1.0 else f"({1.0 / weight:.6g})*{one} + {other}"
    sums = [parse(text)]
    if abs(abs(weight) - 1.0) < EVEN:
        sums.append(parse(f"{one} {'+' if weight > 0.0 else '-'} {other}"))
    values = sums[0].evaluate(problem.inputs.mapping())
    summed = SlotProblem(Inputs(("sum",), values), problem.targets, parsimony=problem.parsimony)
    laws = laws_at(summed, 0, ["sum"])
    return [law.program.with_inputs({"sum": both}) for law in laws for both in sums]
