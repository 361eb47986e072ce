"""The law of a response at a known place in one or two known inputs: of products of two simple forms, and evolved.

Forms have a place and a width, which evolution finds late, so that every form of an input, and every product of two, is
tried at a few of them and the best are fitted. What is no product of two forms is found by symbolic regression. Of two
inputs most laws are a product of a law of each, or a law of a weighted sum: the factors, or the weights, are found
without a shape, and then each is a search in one input. The constants of all are fitted to the residual of the whole
model, seen from the place.
"""

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpmodel.evolution.building_blocks import Vocabulary, promising
from gpmodel.evolution.constants import polish
from gpmodel.evolution.description_length import gain_nats
from gpmodel.evolution.hill_climb import climbed
from gpmodel.evolution.pareto import Solution, description_length, pareto, scored
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import unit_rows
from gpmodel.evolution.regression import regression_front
from gpmodel.evolution.smooth import factors, said_by_poses, smooth_of, through, weighted_sum
from gpmodel.formula.operators import operator_set
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Program

Array = NDArray[np.float64]

FORMS = (
    "{q}", "square({q} - {a})", "sin({n}*({q} - {a}))", "exp(-{w}*square({q} - {a}))", "tanh({k}*({q} - {a}))",
    "max({q} - {a}, 0)", "min({q} - {a}, 0)", "abs({q} - {a})", "{q} - max(min({q}, {a}), -{a})", "exp({k}*{q})",
    "exp(-{k}*{q})", "reciprocal(1 + {w}*square({q} - {a}))", "reciprocal({q} - {low})", "reciprocal({high} - {q})",
    "sqrt({q} - {low})", "sqrt({high} - {q})",
)  # fmt: skip
"""Line, parabola, harmonic, bump, step, ramps, kink, dead band, growth, decay, resonance, poles, roots."""

PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Quantiles of the input at which the forms start."""
STEEP, TURNS = (2.0, 8.0), (2.0, 4.0, 8.0, 12.0)
"""Constants k and n of the forms, over the range of the input."""
BEYOND = 0.25
"""Share of the range by which poles and roots start outside it."""
STARTED, OF_ONE_SHAPE = 12, 2
"""Forms, and products of two, whose constants are fitted, the best; and those of the same two forms."""
EVOLVED, LONGEST = 16, 30
"""Laws of the regression whose constants are fitted, and the nodes that one may have."""
CLIMBED = 3
"""Laws, and pairs of elements, that are climbed from by single edits, the best."""
EFFORT = 12.0
"""Generations of the regression and climbs, together: half a second."""
FEWEST = 3
"""Poses that see the place, of which there is a regression."""
FACTORS = 6
"""Laws of each factor of a product, the shortest descriptions."""
SEEN = 0.1
"""Share of the median weight below which a pose does not see the place."""


@dataclass(frozen=True)
class _Form:
    """A form of one input: which of FORMS, its text and its values (N,)."""

    kind: int
    text: str
    values: Array


def laws_at(
    problem: SlotProblem, site: int, names: Sequence[str], shape: Array, rng: np.random.Generator
) -> tuple[Solution, ...]:
    """Laws of one term at one site in one or two inputs that no shorter one equals in gain, shortest first.

    shape: (N,) what the place does at each pose, as far as it is known; regression is to it and what each pose says
    beyond it, constants and gains are of the problem itself. ``problem.nats(law.gain, law.complexity + 1)`` says what
    each saves; its coefficient is solved. Depends on the arguments only. Raises InputError for an unknown input.
    """
    there = problem.only(site, names)
    there = replace(there, inputs=Inputs(there.inputs.names, there.inputs.values))  # any form of any kind of input
    started = _regressed(there, shape, rng)
    started += list(_started(there)) if len(names) == 1 else [*_products(there, rng), *_of_weighted_sum(there, rng)]
    found = _with_fitted(there, started)
    words = Vocabulary(there.inputs, operator_set("slot"))
    best = sorted(found, key=lambda law: description_length(law, there))
    starts = [law.program for law in best[:CLIMBED]] + [pair for pair, _ in promising(there, words, CLIMBED)]
    found += _with_fitted(there, [climbed(start, there, 0, words, 1) for start in starts])
    return tuple(law for law in pareto(found) if 0 < law.complexity <= LONGEST and law.program.inputs)


def _with_fitted(problem: SlotProblem, programs: Sequence[Program]) -> list[Solution]:
    """Programs as they are, and with fitted constants."""
    columns = problem.inputs.mapping()
    fitted = (polish(program, problem.targets, 0, columns)[0] for program in programs)
    return [scored(program, problem) for program in (*programs, *fitted)]


def _regressed(problem: SlotProblem, shape: Array, rng: np.random.Generator) -> list[Program]:
    """Laws of a shape (N,) by regression, at the poses that see the place."""
    inputs, weight = problem.inputs, problem.targets.weight[0]
    seen = weight > SEEN * np.median(weight)
    response = said_by_poses(problem.targets, shape)[seen]
    if len(response) < FEWEST or not response.std() > 0:
        return []
    clock = itertools.count()
    front = regression_front(
        Inputs(inputs.names, inputs.values[:, seen]), response / response.std(), rng, EFFORT,
        clock=lambda: float(next(clock)),
    )  # fmt: skip
    return [_without_factor(law.program) for law in front if law.program.complexity <= LONGEST][-EVOLVED:]


def _products(problem: SlotProblem, rng: np.random.Generator) -> list[Program]:
    """Products of a law of each of two inputs, each searched as the problem is seen through the other factor."""
    fronts, inputs = [], problem.inputs
    pair = factors(problem.targets, inputs.values)
    for name, other in zip(inputs.names, pair[::-1], strict=True):
        one = SlotProblem(inputs.select([name]), through(problem.targets, other), parsimony=problem.parsimony)
        laws = laws_at(one, 0, [name], smooth_of(one.targets, inputs[name]), rng)
        fronts.append([law.program for law in sorted(laws, key=lambda law: description_length(law, one))[:FACTORS]])
    product = parse("first*second")
    return [product.with_inputs({"first": f, "second": s}) for f, s in itertools.product(*fronts)]


def _of_weighted_sum(problem: SlotProblem, rng: np.random.Generator) -> list[Program]:
    """Laws of the weighted sum of two inputs that says most."""
    first, second = weighted_sum(problem.targets, problem.inputs.values)
    (one, other), weight = (repr(name) for name in problem.inputs.names), second / first
    text = f"{one} + ({weight:.6g})*{other}" if abs(weight) < 1.0 else f"({1.0 / weight:.6g})*{one} + {other}"
    both = parse(text)
    values = both.evaluate(problem.inputs.mapping())
    summed = SlotProblem(Inputs(("sum",), values), problem.targets, parsimony=problem.parsimony)
    laws = laws_at(summed, 0, ["sum"], smooth_of(problem.targets, values[0]), rng)
    return [law.program.with_inputs({"sum": both}) for law in laws]


def _without_factor(program: Program) -> Program:
    """A program without the number that multiplies all of it, which is solved for."""
    root = program.nodes[program.outputs[0]]
    if root.operator == "multiply" and program.nodes[root.arguments[0]].operator == "constant":
        return Program(program.nodes, root.arguments[1:]).select([0])
    return program


def _started(problem: SlotProblem) -> Iterator[Program]:
    """The forms of one input, and products of two of them, that explain most from where they start."""
    ((name, column),) = problem.inputs.mapping().items()
    forms = list(_forms(repr(name), {name: column}))
    for count in (1, 2):
        products = list(itertools.combinations(forms, count))
        values = np.array([np.prod([form.values for form in product], axis=0) for product in products])
        gains = gain_nats(problem.targets.gains(unit_rows(values))[:, 0])
        taken: Counter[tuple[int, ...]] = Counter()
        for k in np.argsort(-gains, kind="stable").tolist():
            shape = tuple(form.kind for form in products[k])
            if taken[shape] < OF_ONE_SHAPE:
                taken[shape] += 1
                yield parse("*".join(f"({form.text})" for form in products[k]))
            if taken.total() == STARTED:
                break


def _forms(text: str, columns: Mapping[str, Array]) -> Iterator[_Form]:
    """Every form of an input, or of another text, at every place and width, where it is a number at every pose."""
    values = parse(text).evaluate(columns)[0]
    low, width = float(values.min()), float(np.ptp(values)) or 1.0
    places = [f"({a:.5g})" for a in np.quantile(values, PLACES).tolist()]
    bounds = {"low": f"({low - BEYOND * width:.5g})", "high": f"({low + (1 + BEYOND) * width:.5g})"}
    for kind, form in enumerate(FORMS):
        turns, steep = (TURNS if "{n}" in form else TURNS[:1]), (STEEP if "{k}" in form else STEEP[:1])
        for a, n, k in itertools.product(places if "{a}" in form else places[:1], turns, steep):
            rates = {"n": f"{n / width:.5g}", "k": f"{k / width:.5g}", "w": f"{20 / width**2:.5g}"}
            filled = form.format(q=text, a=a, **rates, **bounds)
            shape = parse(filled).evaluate(columns)[0]
            if np.isfinite(shape).all():
                yield _Form(kind, filled, shape)
