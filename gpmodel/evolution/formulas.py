"""Search of a formula for the residual at a known site, in one to six known inputs.

Founders (first formulas) in one input are the short forms of ``gpmodel.evolution.founders``. In several inputs a
formula is a product or a sum of formulas in one input each, or a formula of a weighted sum or of a distance. Factors,
summands, weights or the point are estimated as smooth functions first; their residual variance ranks the structures.
Each factor or summand is then searched as a formula of one input. All formulas are bred further
(``gpmodel.evolution.memetic``). Constants are fitted to the residual of the whole model at the site.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.constants import polish
from gpmodel.evolution.founders import binned, founders
from gpmodel.evolution.memetic import GENERATIONS, LONGEST, Formulas, added, evolve_formulas, shortened
from gpmodel.evolution.pareto import Solution, pareto
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import Targets
from gpmodel.evolution.shorter import shorter_forms
from gpmodel.evolution.smooth import (
    distance,
    factors,
    noise_left,
    product_and_summand,
    summands,
    through,
    weighted_sum,
    without,
)
from gpmodel.formula.expression import parse
from gpmodel.formula.program import Program, length

STARTED, STARTED_OF_SEVERAL = 200, 120
"""Number of short forms (first formulas) whose constants are fitted, for a formula of one input and for one part of a
formula of several inputs."""
KEPT = 40
"""Number of formulas of one input that are fitted to binned values first, and to all poses afterwards."""
PIECES, PRODUCTS = 8, 48
"""Number of formulas of shortest description that are kept for each factor, summand, weighted sum or distance; largest
number of products of the kept formulas."""
BEHIND = 40.0
"""Largest log likelihood, nats, that a structure of a formula of several inputs loses to the most likely structure and
is still searched."""
THIRDS = 4
"""Number of inputs that are tried as the third factor of a product with two inputs."""


def formulas_at(
    problem: SlotProblem, site: int, names: Sequence[str], generations: int = GENERATIONS
) -> tuple[Solution, ...]:
    """Return the Pareto front of formulas of one term at a site, in gain, nodes and length of the text, shortest first.

    names: names of the formula's inputs. A third input of the problem is added to two inputs if the third input lowers
    the description length much more. Of more inputs the three of least residual variance remain.
    generations: largest number of generations; with 0 the founders (first formulas) are only shortened.
    ``problem.nats(formula.gain, formula.complexity + 1)`` is the net gain of a formula in nats, with its coefficient
    solved. The result depends on the arguments only. Raises InputError for an unknown input.
    """
    there = problem.only(site, problem.inputs.names)
    there = replace(
        there, inputs=Inputs(there.inputs.names, there.inputs.values)
    )  # without kinds: every operation is allowed
    asked = there.only(0, names)
    population = Formulas(there)
    if len(names) == 1:
        column = asked.inputs.values[0]
        population.add(_of_column(there, names[0], column, asked.targets, (STARTED, KEPT)))
    else:
        structures = _of_two(asked, there) if len(names) == 2 else _of_more(asked)
        population.add(itertools.chain.from_iterable(s.programs() for s in structures if not there.is_over()))
    read = {name for one in population.best(1) for name in one.program.inputs}
    shortened(population)
    evolve_formulas(population, [name for name in there.inputs.names if name in read.union(names)], generations)
    sound = (one for one in population.found if one.complexity <= LONGEST and one.program.inputs)
    return pareto(sound, lambda one: (one.complexity, length(one.program)))


def shorter(program: Program, problem: SlotProblem) -> Iterator[Program]:
    """Yield the program with one node removed, in every possible way, and with its constants fitted."""
    columns = problem.inputs.mapping()
    for one in shorter_forms(program):
        yield polish(one, problem.targets, 0, columns)[0]


@dataclass(frozen=True)
class _Structure:
    """Structure of a formula in its inputs, such as a product of one formula per input.

    noise: residual variance with smooth functions in place of the formulas.
    programs: function that searches the formulas.
    """

    noise: float
    programs: Callable[[], list[Program]]


def _of_two(problem: SlotProblem, every: SlotProblem) -> list[_Structure]:
    """Return the likely structures of a formula of two inputs, or of three if a third input is far more likely."""
    own, further = _structures_of_two(problem), _with_a_third(problem, every)
    least = min(structure.noise for structure in own)
    return _likely(every, [s for s in further if _nats(problem, least, s.noise) > BEHIND] or own)


def _with_a_third(problem: SlotProblem, every: SlotProblem) -> list[_Structure]:
    """Return the product of two inputs and the third input with the least residual variance, or an empty list."""
    pair, columns = problem.inputs.names, every.inputs.mapping()
    rest = sorted(set(columns).difference(pair))
    if not rest:
        return []
    seen = through(problem.targets, np.prod(factors(problem.targets, problem.inputs.values)[1], axis=0))
    likely = sorted(rest, key=lambda name: (noise_left(seen, columns[name]), name))[:THIRDS]
    return [min((_products(every.only(0, (*pair, name))) for name in likely), key=lambda structure: structure.noise)]


def _nats(problem: SlotProblem, noise: float, less: float) -> float:
    """Return the difference in log likelihood, nats, between two fits of residual variance ``noise`` and ``less``."""
    return 0.5 * problem.targets.components * float(np.log(noise / less))


def _of_more(problem: SlotProblem) -> list[_Structure]:
    """Return formula structures of the three inputs with the least residual variance, and of pairs of these three."""
    some = [problem.only(0, names) for names in itertools.combinations(problem.inputs.names, 3)]
    found = [(structure(only), only) for only in some for structure in (_products, _of_weighted_sum)]
    found += [(_product_and_summand(only, last), only) for only in some for last in only.inputs.names]
    three = min(found, key=lambda pair: pair[0].noise)[1]
    pairs = (three.only(0, names) for names in itertools.combinations(three.inputs.names, 2))
    of_two = itertools.chain.from_iterable(map(_structures_of_two, pairs))
    return _likely(problem, [*(s for s, only in found if only is three), *of_two])


def _structures_of_two(problem: SlotProblem) -> list[_Structure]:
    return [structure(problem) for structure in (_products, _sums, _of_weighted_sum, _of_distance)]


def _likely(problem: SlotProblem, structures: Sequence[_Structure]) -> list[_Structure]:
    """Return the formula structures whose log likelihood is within BEHIND nats of the most likely structure."""
    least = min(structure.noise for structure in structures)
    return [one for one in structures if _nats(problem, one.noise, least) <= BEHIND]


def _products(problem: SlotProblem) -> _Structure:
    """Return products of one formula per input; each factor is searched with smooth functions as the other factors."""
    noise, values = factors(problem.targets, problem.inputs.values)

    def programs() -> list[Program]:
        others = (np.prod(np.delete(values, k, axis=0), axis=0) for k in range(len(values)))
        seen = (through(problem.targets, other) for other in others)
        fronts = _of_each(problem, *seen)
        names = [f"factor_{k}" for k in range(len(fronts))]
        product = parse("*".join(names))
        most = round(PRODUCTS ** (1 / len(fronts)))
        chosen = itertools.product(*(front[:most] for front in fronts))
        return [product.with_inputs(dict(zip(names, some, strict=True))) for some in chosen]

    return _Structure(noise, programs)


def _sums(problem: SlotProblem) -> _Structure:
    """Return sums of one formula for each of two inputs; a formula is searched with the other summand subtracted."""
    first, second = summands(problem.targets, problem.inputs.values)
    seen = without(problem.targets, second), without(problem.targets, first)

    def programs() -> list[Program]:
        return [added(problem, *pair) for pair in itertools.product(*_of_each(problem, *seen))]

    return _Structure(noise_left(seen[0], problem.inputs.values[0]), programs)


def _product_and_summand(problem: SlotProblem, last: str) -> _Structure:
    """Return sums of a formula of the input ``last`` and a product of formulas of the other inputs. Product and summand
    are each searched with the other one subtracted as a smooth function."""
    factor_names = [name for name in problem.inputs.names if name != last]
    columns = np.array([problem.inputs[name] for name in (*factor_names, last)])
    noise, product, summand = product_and_summand(problem.targets, columns)

    def programs() -> list[Program]:
        rest = problem.only(0, factor_names)
        rest = replace(rest, targets=without(problem.targets, summand))
        population = Formulas(rest)
        population.add(_products(rest).programs())
        firsts = [one.program for one in population.best(PIECES)]
        seen = without(problem.targets, product)
        seconds = _of_column(problem, last, columns[-1], seen)
        return [added(problem, *pair) for pair in itertools.product(firsts, seconds)]

    return _Structure(noise, programs)


def _of_each(problem: SlotProblem, *targets: Targets) -> list[list[Program]]:
    """Return formulas for each input of a problem, searched in the residual statistics (Targets) of the input."""
    inputs = zip(problem.inputs.names, problem.inputs.values, targets, strict=True)
    return [_of_column(problem, name, column, seen) for name, column, seen in inputs]


def _of_column(
    problem: SlotProblem, name: str, column: Array, targets: Targets,
    most: tuple[int, int] = (STARTED_OF_SEVERAL, PIECES),
) -> list[Program]:  # fmt: skip
    """Return formulas of shortest description of one input with values `column`.
    most: number of founders (first formulas) whose constants are fitted, and number of returned formulas."""
    few, seen = binned(column, targets)
    population = Formulas(replace(problem, inputs=Inputs((name,), few[None]), targets=seen))
    population.add([parse(repr(name)), *founders(name, column, targets, most[0])])
    return [one.program for one in population.best(most[1])]


def _of_weighted_sum(problem: SlotProblem) -> _Structure:
    """Return formulas of a weighted sum of the inputs; the weights maximise the evidence of a smooth function."""
    weights = weighted_sum(problem.targets, problem.inputs.values)
    weights = weights / weights[np.argmax(np.abs(weights))]
    pairs = zip(problem.inputs.names, weights.tolist(), strict=True)
    terms = (repr(name) if weight == 1.0 else f"({weight:.6g})*{name!r}" for name, weight in pairs)
    return _of_any(problem, parse(" + ".join(terms)))


def _of_distance(problem: SlotProblem) -> _Structure:
    """Return formulas of a distance in the plane of two inputs, from the point of highest log evidence."""
    (one, other), (a, b, w) = map(repr, problem.inputs.names), distance(problem.targets, problem.inputs.values)
    return _of_any(problem, parse(f"hypot({one} - ({a:.6g}), ({w:.6g})*({other} - ({b:.6g})))"))


def _of_any(problem: SlotProblem, joined: Program) -> _Structure:
    """Return formulas f(u) of one variable u: the value of the program ``joined``, such as a weighted sum of inputs."""
    column, targets = joined.evaluate(problem.inputs.mapping())[0], problem.targets

    def programs() -> list[Program]:
        found = _of_column(problem, "joined", column, targets)
        return [one.with_inputs({"joined": joined}) for one in found]

    return _Structure(noise_left(targets, column), programs)
