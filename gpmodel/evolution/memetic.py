"""Breeding of formulas at one site: composition, products, sums and single edits, with fits of constants.

An individual is an expression with one output. The coefficient of an expression is solved by projection, and its
constants are fitted by variable projection (``constants.polish``). Offspring are compared by the net gain, nats, with
their initial constants; the constants of the best are fitted. Selection is by description length: components / 2 * ln(1
- gain) + parsimony * (size + 1)
Two individuals are equal if their columns, projected out of the model and normalised, agree to four digits.
Source: Moscato (1989), memetic algorithms; Golub and Pereyra (1973), variable projection.
"""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from gpmodel.arrays import LARGEST, Array
from gpmodel.evolution.constants import polish
from gpmodel.evolution.founders import ELEMENTS, Trial, combine, constant
from gpmodel.evolution.pareto import Solution, description_length
from gpmodel.evolution.problems import SlotProblem
from gpmodel.evolution.shorter import replaced, scaled_in, shorter_forms
from gpmodel.formula.expression import parse
from gpmodel.formula.program import Node, Program, description_size

LONGEST = 30
"""Largest number of nodes of an evolved formula."""
PARENTS, OFFSPRING, GENERATIONS = 6, 20, 3
"""Number of parents, which are the formulas of shortest description; number of offspring whose constants are fitted;
largest number of generations."""
IMPROVED = 1.0
"""Least fall of the description length in a generation, nats, for another generation to follow."""
DIGITS = 1e-4
"""Difference of normalised projected columns below which two formulas count as equal."""


class Formulas:
    """A population of formulas: basis functions at the first site of a problem. Each different formula is fitted once.
    allows: function that returns whether a program is allowed as a formula. loss: function that returns a share of the
    residual sum of squares as a penalty of a program, in addition to its residual."""

    def __init__(
        self, problem: SlotProblem, allows: Callable[[Program], bool] = lambda _: True,
        loss: Callable[[Program, float], float] = lambda *_: 0.0,
    ) -> None:  # fmt: skip
        self.problem, self.allows, self.loss = problem, allows, loss
        self.columns = problem.inputs.mapping()
        self.found: list[Solution] = []
        self.generation = 0
        self._begun: set[tuple[bytes, int]] = set()
        self._places: dict[bytes, int] = {}
        targets = problem.targets
        self.holds_constants = not targets.gains(np.ones((1, targets.poses)))[0] > 0.0

    def add(self, programs: Iterable[Program]) -> None:
        """Fit the constants of programs whose columns are new, and add them."""
        for one in map(_centred, programs) if self.holds_constants else programs:
            if one.inputs and one.complexity <= LONGEST and self.allows(one) and not self.problem.is_over():
                key = self._column(one.evaluate(self.columns)[0]), one.complexity
                if key[0] and key not in self._begun:
                    self._begun.add(key)
                    self.take(polish(one, self.problem.targets, 0, self.columns)[0])

    def take(self, program: Program) -> None:
        """Add a program with its constants unchanged. Of programs with equal columns only the shortest stays."""
        values = program.evaluate(self.columns)
        column = self._column(values[0])
        place = self._places.setdefault(column, len(self.found))
        if not column or (place < len(self.found) and self.found[place].complexity <= description_size(program)):
            return
        gain, coefficients = self.problem.targets.set_gain(values, 0)
        name, size = self.problem.targets.names[0], description_size(program)
        gain -= self.loss(program, float(coefficients[0]))
        one = Solution(program, 0, name, gain, coefficients, size, generation=self.generation)
        self.found[place : place + 1] = [one]

    def best(self, count: int) -> list[Solution]:
        """Return the ``count`` shortest descriptions; of formulas that differ in constants alone, only the best one."""
        of_form: dict[tuple[Node, ...], Solution] = {}
        for one in sorted(self.found, key=lambda solution: description_length(solution, self.problem)):
            form = (node._replace(value=None) if node.operator == "constant" else node for node in one.program.nodes)
            of_form.setdefault(tuple(form), one)
        return list(of_form.values())[:count]

    def nats(self) -> float:
        """Return the net gain of the best formula: the decrease of the description length, nats."""
        return max((-description_length(one, self.problem) for one in self.found), default=0.0)

    def _column(self, values: Array) -> bytes:
        """Return the projected, normalised column of a formula to four digits; empty if it is zero or not finite."""
        targets = self.problem.targets
        with np.errstate(all="ignore"):
            values = values / np.abs(values).max()
            projected = targets.weight[0] * values - (targets.cross[0] @ values) @ targets.cross[0]
            size = float(projected @ values)
            column = projected / np.sqrt(size)
        if not size > 0 or not np.isfinite(column).all():
            return b""
        column = column * np.sign(column[np.argmax(np.abs(column))]) / np.abs(column).max()
        return bytes(np.round(column / DIGITS).astype(np.int32))


def _centred(program: Program) -> Program:
    """Replace logistic(c x) by tanh(c/2 x). The difference is a constant, which the geometric constants contain."""
    root = program.outputs[0]
    if program.nodes[root].operator != "logistic":
        return program
    inside = program.nodes[program.nodes[root].arguments[0]]
    scales = {k: program.nodes[k].value for k in inside.arguments if program.nodes[k].operator == "constant"}
    if inside.operator != "multiply" or len(scales) != 1:
        return program
    ((scale, value),) = scales.items()
    (scaled,) = (k for k in inside.arguments if k != scale)
    return replaced(program, {root: partial(scaled_in, "tanh", 0.5 * float(value or 0.0), scaled)})


def evolve_formulas(population: Formulas, names: Sequence[str], generations: int = GENERATIONS) -> None:
    """Breed formulas until a generation no longer improves the best one. names: inputs that formulas may use."""
    before = population.nats()
    varying = ((name, population.columns[name]) for name in names)
    elements = {name: ELEMENTS.on_grid(column[None])[0] for name, column in varying if np.ptp(column) > 0}
    for population.generation in range(1, generations + 1):
        parents = [one.program for one in population.best(PARENTS)]
        population.add(_offspring(population, parents, elements))
        shortened(population)
        if population.nats() < before + IMPROVED or population.problem.is_over():
            break
        before = population.nats()


def shortened(population: Formulas) -> None:
    """Add the shorter forms of the best formulas until the description length no longer falls."""
    before = -np.inf
    while (most := population.nats()) > before and not population.problem.is_over():
        before, best = most, population.best(PARENTS)
        population.add(itertools.chain.from_iterable(_promising(population.problem, one, most) for one in best))


def _promising(problem: SlotProblem, one: Solution, most: float) -> Iterator[Program]:
    """Yield the shorter forms of a formula whose net gain would exceed `most`, nats, at the gain of the formula."""
    for shorter in shorter_forms(one.program):
        if problem.nats(one.gain, description_size(shorter) + len(one.coefficients)) > most:
            yield shorter


def _offspring(population: Formulas, parents: Sequence[Program], elements: Mapping[str, Array]) -> list[Program]:
    """Return the most promising offspring. elements: {input: values (elements, poses) of the elements of the input}."""
    trials: list[Trial] = []
    for program in itertools.takewhile(lambda _: not population.problem.is_over(), parents):
        values = program.evaluate(population.columns)[0]
        trials += _composed(population, program, values)
        for name, of_input in itertools.takewhile(lambda _: not population.problem.is_over(), elements.items()):
            trials += _joined(population, program, values, name, of_input)
    best = sorted(trials, key=lambda trial: -trial.nats)[:OFFSPRING]
    return [trial.build() for trial in best]


def _composed(population: Formulas, program: Program, values: Array) -> Iterator[Trial]:
    """Yield elements applied to a formula; nothing if the formula's values are too small or too large to be squared."""
    problem, low, width = population.problem, float(values.min()), float(np.ptp(values))
    if not 1.0 / LARGEST < width < LARGEST:
        return
    with np.errstate(all="ignore"):
        gains = problem.targets.gains(ELEMENTS.on_grid(values[None])[0])
    nats = problem.nats(gains, program.complexity + 1 + SIZES)
    yield from ELEMENTS.best(np.asarray(nats), lambda k: ELEMENTS.every[k].program(program, low, width))


def _joined(population: Formulas, program: Program, values: Array, name: str, elements: Array) -> Iterator[Trial]:
    """Yield products and sums of a formula and the elements of an input. elements: values (elements, poses)."""
    problem, column = population.problem, population.columns[name]
    plain, low, width = parse(repr(name)), float(column.min()), float(np.ptp(column))
    size = program.complexity + 2 + SIZES

    def factor(k: int) -> Program:
        return combine("multiply", program, ELEMENTS.every[k].program(plain, low, width))

    def summand(k: int) -> Program:
        return added(problem, program, ELEMENTS.every[k].program(plain, low, width))

    gains = problem.targets.gains(values * elements)
    yield from ELEMENTS.best(np.asarray(problem.nats(gains, size)), factor)
    gains = problem.targets.gains(elements, given=values)
    yield from ELEMENTS.best(np.asarray(problem.nats(gains, size + 2)), summand)


def added(problem: SlotProblem, first: Program, second: Program) -> Program:
    """Return the sum of two formulas, with the ratio of their coefficients solved."""
    columns = problem.inputs.mapping()
    one, other = problem.targets.set_gain(np.vstack([first.evaluate(columns), second.evaluate(columns)]), 0)[1].tolist()
    return combine("add", first, combine("multiply", constant(other / (one or 1.0)), second))


SIZES = np.array([element.size for element in ELEMENTS.every], dtype=float)
"""Number of nodes that each formula element, such as a wave or step, adds to a formula."""
