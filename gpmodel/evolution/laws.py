"""The law of a response at a known place in one or two known inputs: of products of two simple forms, and evolved.

Forms have a place and a width, which evolution finds late, so that every form of an input, and every product of two, is
tried at a few of them and the best are fitted. What is no product of two forms is found by symbolic regression. The
constants of both are fitted to the residual of the whole model, seen from the place.
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
from gpmodel.formula.operators import operator_set
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Program

Array = NDArray[np.float64]

FORMS = (
    "{q}", "square({q} - {a})", "sin({n}*({q} - {a}))", "exp(-{w}*square({q} - {a}))", "tanh({k}*({q} - {a}))",
    "max({q} - {a}, 0)", "min({q} - {a}, 0)", "abs({q} - {a})", "{q} - max(min({q}, {a}), -{a})", "exp({k}*{q})",
    "exp(-{k}*{q})", "reciprocal({q} - {low})", "reciprocal({high} - {q})", "sqrt({q} - {low})", "sqrt({high} - {q})",
)  # fmt: skip
"""Line, parabola, harmonic, bump, step, ramps, kink, dead band, growth, decay, pole, root."""

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
EFFORT = 30.0
"""Generations of the regression and climbs, together: one or two seconds."""
SEEN = 0.1
"""Share of the median weight below which a pose does not see the place."""


@dataclass(frozen=True)
class _Form:
    """A form of one input: which of FORMS, its text and its values (N,)."""

    kind: int
    text: str
    values: Array


def laws_at(
    problem: SlotProblem, site: int, names: Sequence[str], response: Array, rng: np.random.Generator
) -> tuple[Solution, ...]:
    """Laws of one term at one site in one or two inputs that no shorter one equals in gain, shortest first.

    response: (N,) what the place does at each pose, as far as it is known; regression is to it, constants and gains to
    the problem itself. ``problem.nats(law.gain, law.complexity + 1)`` says what each saves; its coefficient is solved.
    Depends on the arguments only. Raises InputError for an unknown input.
    """
    there = problem.only(site, names)
    there = replace(there, inputs=Inputs(there.inputs.names, there.inputs.values))  # any form of any kind of input
    columns = there.inputs.mapping()
    weight = there.targets.weight[0]
    seen = weight > SEEN * np.median(weight)
    clock = itertools.count()
    asked = Inputs(there.inputs.names, there.inputs.values[:, seen])
    front = regression_front(
        asked, response[seen] / response[seen].std(), rng, EFFORT, clock=lambda: float(next(clock))
    )
    evolved = [_without_factor(law.program) for law in front if law.program.complexity <= LONGEST]
    started = [*_started(there), *evolved[-EVOLVED:]]

    def with_fitted(programs: Sequence[Program]) -> list[Solution]:
        fitted = (polish(program, there.targets, 0, columns)[0] for program in programs)
        return [scored(program, there) for program in (*programs, *fitted)]

    found = with_fitted(started)
    words = Vocabulary(there.inputs, operator_set("slot"))
    best = sorted(found, key=lambda law: description_length(law, there))
    starts = [law.program for law in best[:CLIMBED]] + [pair for pair, _ in promising(there, words, CLIMBED)]
    found += with_fitted([climbed(start, there, 0, words, 1) for start in starts])
    return tuple(law for law in pareto(found) if 0 < law.complexity <= LONGEST and law.program.inputs)


def _without_factor(program: Program) -> Program:
    """A program without the number that multiplies all of it, which is solved for."""
    root = program.nodes[program.outputs[0]]
    if root.operator == "multiply" and program.nodes[root.arguments[0]].operator == "constant":
        return Program(program.nodes, root.arguments[1:]).select([0])
    return program


def _started(problem: SlotProblem) -> Iterator[Program]:
    """The forms and products of two that explain most from where they start."""
    columns = problem.inputs.mapping()
    forms = {name: list(_forms(repr(name), columns)) for name in columns}
    alone: list[tuple[_Form, ...]] = [(form,) for own in forms.values() for form in own]
    if len(columns) == 2:
        first, second = (repr(name) for name in columns)
        for both in (f"({first} + {second})", f"({first} - {second})"):
            alone += [(form,) for form in _forms(both, columns)]
        pairs: list[tuple[_Form, ...]] = list(itertools.product(*forms.values()))
    else:
        (own,) = forms.values()
        pairs = list(itertools.combinations(own, 2))
    for products in (alone, pairs):
        values = np.array([np.prod([form.values for form in factors], axis=0) for factors in products])
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
