"""The law of a response at a known place in one, two or three known inputs.

Of one input every short shape is looked at (``gpmodel.evolution.shapes``); the best are fitted and climbed from by
single edits. Of two inputs a law is a product or a sum of a law of each, or a law of a weighted sum or of a distance:
factors, summands, weights or the point are found without a shape, which tells the form; then each is a search in one
input. Of three inputs it is the product of a law of each, or a law of two. Constants are fitted to the residual of the
whole model, seen from the place.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.building_blocks import Vocabulary, promising
from gpmodel.evolution.constants import polish
from gpmodel.evolution.hill_climb import climbed
from gpmodel.evolution.pareto import Solution, description_length, pareto, scored
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import Targets
from gpmodel.evolution.shapes import shapes
from gpmodel.evolution.smooth import (
    distance,
    factors,
    noise_left,
    others,
    summands,
    through,
    weighted_sum,
    without,
)
from gpmodel.formula.length import length
from gpmodel.formula.operators import BY_NAME, WRITTEN, operator_set
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Builder, Node, Program

STARTED = 200
"""Shapes whose constants are fitted, those that gain most before."""
LONGEST = 30
"""Nodes that a law may have."""
CLIMBED = 3
"""Laws of one input, and pairs of elements, that are climbed from by single edits, the best."""
SHORTENED = 3
"""Laws of one input of which those of a node less are looked at, the best."""
FACTORS, PRODUCTS = 8, 64
"""Laws of each factor, summand, weighted sum or distance, the shortest descriptions, and products of them at most."""
BEHIND = 40.0
"""Nats by which a form of several inputs may fit worse than the best without a shape, and its law is still searched."""
THIRDS = 4
"""Third inputs that are looked at in a product with two others."""
EVEN = 0.05
"""Weights so far from one at most, whose plain sum or difference is offered too, as of angles in one plane."""


def laws_at(problem: SlotProblem, site: int, names: Sequence[str]) -> tuple[Solution, ...]:
    """Laws of one term at one site, shortest first: those that none of as few nodes equals in gain, unless they are
    shorter to read. In one input or two, in two and a third of the problem where it says much more, or of more in the
    three whose product leaves least noise.

    ``problem.nats(law.gain, law.complexity + 1)`` says what each saves; its coefficient is solved. Depends on the
    arguments only. Raises InputError for an unknown input.
    """
    there = problem.only(site, problem.inputs.names)
    there = replace(there, inputs=Inputs(there.inputs.names, there.inputs.values))  # any form of any kind of input
    asked = there.only(0, names)
    found = _of_one(asked) if len(names) == 1 else _of_two(asked, there) if len(names) == 2 else _of_more(asked)
    return pareto(filter(_sound, found), lambda law: (law.complexity, length(law.program)))


def _sound(law: Solution) -> bool:
    return 0 < law.complexity <= LONGEST and bool(law.program.inputs)


def _best(found: Iterable[Solution], problem: SlotProblem, most: int) -> list[Program]:
    """The laws of the shortest descriptions, one of those that differ in constants alone."""
    of_form: dict[tuple[Node, ...], Program] = {}
    for law in sorted(found, key=lambda law: description_length(law, problem)):
        form = (replace(node, value=None) if node.operator == "constant" else node for node in law.program.nodes)
        of_form.setdefault(tuple(form), law.program)
    return list(of_form.values())[:most]


def _of_one(problem: SlotProblem) -> list[Solution]:
    """One input and shapes of it, what climbing makes of the best, and the best less a node each, all fitted."""
    ((name, column),) = problem.inputs.mapping().items()
    found = _fitted(problem, [parse(repr(name)), *shapes(name, column, problem.targets, STARTED)])
    words = Vocabulary(problem.inputs, operator_set("slot"))
    starts = _best((law for law in found if _edited(law.program)), problem, CLIMBED)
    starts += [pair for pair, _ in promising(problem, words, CLIMBED)]
    found += _fitted(problem, [climbed(start, problem, 0, words, 1) for start in starts])
    best = _best(found, problem, SHORTENED)
    return found + [scored(fewer, problem) for program in best for fewer in shorter(program, problem)]


def _edited(program: Program) -> bool:
    """Whether single edits know all that the program is made of: an edge they do not."""
    made_of = {node.operator for node in program.nodes} - {"input", "constant"}
    return all(BY_NAME[name].code < WRITTEN for name in made_of)


def shorter(program: Program, problem: SlotProblem) -> Iterator[Program]:
    """The program with one of its nodes given way to one of that node's arguments, its constants fitted, for every
    node and argument that leave an input."""
    columns = problem.inputs.mapping()
    for index, argument in [(i, k) for i, left in enumerate(program.nodes) for k in left.arguments]:
        fewer = program.rebuilt(partial(_given_way, index, argument))
        if fewer.inputs:
            yield polish(fewer, problem.targets, 0, columns)[0]


def _given_way(index: int, argument: int, builder: Builder, node: Node, copies: list[int]) -> int:
    return copies[argument] if len(copies) == index else builder.add(node, copies)


def _fitted(problem: SlotProblem, programs: Iterable[Program]) -> list[Solution]:
    """Programs with fitted constants."""
    columns = problem.inputs.mapping()
    return [scored(polish(program, problem.targets, 0, columns)[0], problem) for program in programs]


@dataclass(frozen=True)
class _Form:
    """How a law is made of its inputs. noise: the variance that it leaves without a shape. laws: the search for one."""

    noise: float
    laws: Callable[[], list[Program]]


def _of_two(problem: SlotProblem, every: SlotProblem) -> list[Solution]:
    """Laws of two inputs, or of these and a third of every one beside which no form of two is likely, fitted."""
    forms, further = _forms_of_two(problem), _with_a_third(problem, every)
    least = min(form.noise for form in forms)
    return _of_likely(every, [f for f in further if _nats(problem, least, f.noise) > BEHIND] or forms)


def _with_a_third(problem: SlotProblem, every: SlotProblem) -> list[_Form]:
    """The product of a law of each of two inputs and of the third that leaves least noise, of those that say most
    beside the two as they are without it."""
    pair, columns = problem.inputs.names, every.inputs.mapping()
    seen = through(problem.targets, np.prod(factors(problem.targets, problem.inputs.values)[1], axis=0))
    likely = sorted(set(columns).difference(pair), key=lambda name: (noise_left(seen, columns[name]), name))[:THIRDS]
    products = (_products(every.only(0, (*pair, name))) for name in likely)
    return sorted(products, key=lambda form: form.noise)[:1]


def _nats(problem: SlotProblem, noise: float, less: float) -> float:
    """Nats by which what leaves less noise is likelier."""
    return 0.5 * problem.targets.components * float(np.log(noise / less))


def _of_more(problem: SlotProblem) -> list[Solution]:
    """Laws of the three inputs whose product leaves least noise, or of two of these, fitted."""
    some = (problem.only(0, names) for names in itertools.combinations(problem.inputs.names, 3))
    product, three = min(((_products(only), only) for only in some), key=lambda found: found[0].noise)
    pairs = (three.only(0, names) for names in itertools.combinations(three.inputs.names, 2))
    return _of_likely(problem, [product, *itertools.chain.from_iterable(map(_forms_of_two, pairs))])


def _forms_of_two(problem: SlotProblem) -> list[_Form]:
    return [form(problem) for form in (_products, _sums, _of_weighted_sum, _of_distance)]


def _of_likely(problem: SlotProblem, forms: Sequence[_Form]) -> list[Solution]:
    """Laws of every form that is nearly as likely as any, fitted."""
    least = min(form.noise for form in forms)
    likely = [form for form in forms if _nats(problem, form.noise, least) <= BEHIND]
    return _fitted(problem, [program for form in likely for program in form.laws()])


def _products(problem: SlotProblem) -> _Form:
    """Products of a law of each input, each searched as the problem is seen through the other factors."""
    noise, values = factors(problem.targets, problem.inputs.values)

    def laws() -> list[Program]:
        seen = (through(problem.targets, others(values, k)) for k in range(len(values)))
        fronts = _of_each(problem, *seen)
        most = round(PRODUCTS ** (1 / len(fronts)))
        names = [f"factor_{k}" for k in range(len(fronts))]
        product = parse("*".join(names))
        chosen = itertools.product(*(front[:most] for front in fronts))
        return [product.with_inputs(dict(zip(names, some, strict=True))) for some in chosen]

    return _Form(noise, laws)


def _sums(problem: SlotProblem) -> _Form:
    """Sums of a law of each of two inputs, each searched with the other summand taken off the residual."""
    first, second = summands(problem.targets, problem.inputs.values)
    seen = without(problem.targets, second), without(problem.targets, first)

    def laws() -> list[Program]:
        found, columns = [], problem.inputs.mapping()
        for f, s in itertools.product(*_of_each(problem, *seen)):
            one, other = problem.targets.set_gain(np.vstack([f.evaluate(columns), s.evaluate(columns)]), 0)[1].tolist()
            weighted = parse(f"first + ({other / (one or 1.0):.6g})*second")
            found.append(weighted.with_inputs({"first": f, "second": s}))
        return found

    return _Form(noise_left(seen[0], problem.inputs.values[0]), laws)


def _of_each(problem: SlotProblem, *targets: Targets) -> list[list[Program]]:
    """Laws of each input of a problem on targets of its own."""
    inputs = zip(problem.inputs.names, problem.inputs.values, targets, strict=True)
    return [_of_column(name, column, seen, problem.parsimony) for name, column, seen in inputs]


def _of_column(name: str, column: Array, targets: Targets, parsimony: float) -> list[Program]:
    """Laws of a column (N,) of a name, the shortest descriptions."""
    problem = SlotProblem(Inputs((name,), column[None]), targets, parsimony=parsimony)
    return _best(filter(_sound, _of_one(problem)), problem, FACTORS)


def _of_weighted_sum(problem: SlotProblem) -> _Form:
    """Laws of the weighted sum of two inputs that says most, and of the plain one beside it."""
    first, second = weighted_sum(problem.targets, problem.inputs.values)
    (one, other), weight = (repr(name) for name in problem.inputs.names), second / first
    text = f"{one} + ({weight:.6g})*{other}" if abs(weight) < 1.0 else f"({1.0 / weight:.6g})*{one} + {other}"
    sums = [parse(text)]
    if abs(abs(weight) - 1.0) < EVEN:
        sums.append(parse(f"{one} {'+' if weight > 0.0 else '-'} {other}"))
    return _of_any(problem, sums)


def _of_distance(problem: SlotProblem) -> _Form:
    """Laws of the distance from a point in the plane of two inputs that says most."""
    (one, other), (a, b, w) = map(repr, problem.inputs.names), distance(problem.targets, problem.inputs.values)
    return _of_any(problem, [parse(f"hypot({one} - ({a:.6g}), ({w:.6g})*({other} - ({b:.6g})))")])


def _of_any(problem: SlotProblem, joined: Sequence[Program]) -> _Form:
    """Laws of what two inputs are joined to, searched for the first way and offered for all."""
    column, targets = joined[0].evaluate(problem.inputs.mapping())[0], problem.targets

    def laws() -> list[Program]:
        found = _of_column("joined", column, targets, problem.parsimony)
        return [law.with_inputs({"joined": both}) for law in found for both in joined]

    return _Form(noise_left(targets, column), laws)
