"""Short formulas from which longer ones are bred: elements of one input, elements of elements, products of two.

An element is an operator of k (u - c), where u is the input scaled to [0, 1]: line, power, wave, bump, ramp, step, dead
zone, saturation, pole, root, logarithm. Some forty thousand short forms, on a grid of k and c, are compared by
projection; their constants are fitted afterwards. A step has no derivative with respect to its position; steps are
tried between all neighbouring values. Source: Bartlett, Desmond and Ferreira (2024), exhaustive symbolic regression.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain, combinations, product

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evolution.description_length import fit_nats
from gpmodel.evolution.projection import Targets
from gpmodel.formula.expression import parse
from gpmodel.formula.operators import BY_NAME
from gpmodel.formula.program import Builder, Node, Program

INSIDE, OUTSIDE = (0.1, 0.9, 4), (0.02, 0.1, 0.4)
"""Grid of the position of an element of a formula in the scaled input (0 to 1): first value, last value, number of
steps; distances of poles and roots from the range of the input."""
STEEP, TURNS, GROWTH, WIDTHS = (2.0, 25.0, 2), (2.0, 24.0, 8), (1.5, 20.0, 2), (3.0, 8.0, 1)
"""Grids of the rate k of smooth steps, waves, exponentials, and bumps and resonances, per range of the input: first
value, last value, number of steps."""
ROOTS = 0.1, 1.0, 8
"""Grid of the distances of a cubic's outer roots from its middle root: first value, last value, number of steps. With
four steps a plain cubic began so inaccurate that two hundred other shapes ranked above the cubic."""
EXPONENTS = (0.75, 1.25, 2.0)
"""Exponents p of the odd powers x |x|^p of the first formulas; even powers start at p + 1."""
ALONE = 3
"""Factor by which the grid of constants is finer for single elements: a sine of a wrong rate explains nothing."""
LINE = "({q} - {a})"
"""Text of the formula element that is the input minus a constant."""
EDGE, BESIDE_EDGE = "step({q} - {a})", 0.05
"""Text of the step element; least fraction of the poses on either side of a step."""
JOINED = 4.0
"""Least gain, nats, of a further element of a formula: about the penalty of the element's nodes and constants."""
APART = 1.001
"""Ratio by which one of two constants of equal grid value is changed, so that both are fitted separately."""
BINS, CHUNK = 64, 1_000_000
"""Number of values of an input at which formula elements are compared; largest size of an array of compositions."""


@dataclass(frozen=True)
class Element:
    """An element of formulas: a function of x = k (u - c), where u is the input scaled to [0, 1].

    text: shape of the element, a formula in the unit of the input with {q} for the input, {k} for k, {a} for c, {b} for
    c + 1/k, {d} for 1/k² and {e} for -k².
    """

    text: str
    function: Callable[[Array], Array]
    k: float = 1.0
    c: float = 0.0

    def program(self, inner: Program, low: float, width: float) -> Program:
        """Return the program of the element at an inner program whose values range from ``low`` to ``low + width``."""
        with np.errstate(all="ignore"):
            scale = np.float64(width) / self.k
            numbers = {"k": 1.0 / scale, "a": low + self.c * width, "b": low + self.c * width + scale}
            numbers |= {"d": np.square(scale), "e": -np.square(1.0 / scale)}
        leaves = {name: Node("constant", (), float(f"{n:.6g}")) for name, n in numbers.items()}
        if len(inner.nodes) == 1:
            leaves["q"] = inner.nodes[0]
        filled = _template(self.text)
        filled = filled.with_leaves(
            node if node.arguments else leaves.get(str(node.value), node) for node in filled.nodes
        )
        return filled if len(inner.nodes) == 1 else filled.with_inputs({"q": inner})

    @property
    def size(self) -> int:
        """Number of nodes that the element adds to a formula."""
        return _template(self.text).complexity - 1


@cache
def _template(text: str) -> Program:
    """Parse the text of a formula element as a program whose inputs are the placeholders q, k, a, b, d and e."""
    return parse(text.format(**{name: name for name in "qkabde"}))


def constant(value: float) -> Program:
    """Return a program that consists of a constant, rounded to six digits."""
    builder = Builder()
    return builder.program([builder.constant(float(f"{value:.6g}"))])


def _inside(finer: int) -> list[float]:
    """Return the positions of formula elements on a grid with ``finer`` times as many steps as `INSIDE`."""
    first, last, steps = INSIDE
    return list(np.linspace(first, last, steps * finer + 1).tolist())


def _in_proportion(numbers: tuple[float, float, int], finer: int = 1) -> list[float]:
    """Return a geometric grid from (first value, last value, number of steps), with ``finer`` times as many steps."""
    first, last, steps = numbers
    return list(np.geomspace(first, last, steps * finer + 1).tolist())


def _elements(finer: int = 1) -> Iterator[Element]:
    """Yield lines, powers, kinks, ramps, dead zones, waves, steps, bumps, resonances, exponentials, roots, logarithms,
    poles."""
    apply = {name: operator.function for name, operator in BY_NAME.items()}
    inside = _inside(finer)
    steep, turns, growth, widths = (_in_proportion(numbers, finer) for numbers in (STEEP, TURNS, GROWTH, WIDTHS))
    for c in inside:
        yield Element(LINE, lambda x: x, c=c)
        yield Element("square({q} - {a})", np.square, c=c)
        yield Element("abs({q} - {a})", np.abs, c=c)
        yield Element("({q} - {a})*sqrt(abs({q} - {a}))", lambda x: x * np.sqrt(np.abs(x)), c=c)
        yield Element("({q} - {a})*abs({q} - {a})", lambda x: x * np.abs(x), c=c)
        yield Element("max({q} - {a}, 0)", lambda x: np.maximum(x, 0.0), c=c)
        yield Element("min({q} - {a}, 0)", lambda x: np.minimum(x, 0.0), c=c)
        yield from (Element("sin({k}*({q} - {a}))", np.sin, k, c) for k in turns)
        for name, k in product(("tanh", "atan"), steep):
            yield Element(name + "({k}*({q} - {a}))", apply[name], k, c)
        yield from (Element("logistic({k}*({q} - {a}))", apply["logistic"], s * k, c) for s in (1, -1) for k in steep)
        for k in widths:
            yield Element("exp({e}*square({q} - {a}))", lambda x: np.exp(-x * x), k, c)
            yield Element("reciprocal({d} + square({q} - {a}))", lambda x: 1.0 / (1.0 + x * x), k, c)
    for c, d in combinations(inside, 2):
        yield Element("({q} - {a})*({q} - {b})", lambda x: x * (x - 1.0), 1.0 / (d - c), c)
        yield Element("deadzone({k}*({q} - {a}))", apply["deadzone"], 2.0 / (d - c), 0.5 * (c + d))
    yield from (Element("exp({k}*{q})", np.exp, sign * k, float(sign > 0)) for k, sign in product(growth, (1, -1)))
    for name, d in product(("sqrt", "log", "reciprocal"), OUTSIDE):
        yield Element(name + "({q} - {a})", apply[name], 1.0, -d)
        yield Element(name + "({a} - {q})", partial(lambda f, x: f(-x), apply[name]), 1.0, 1.0 + d)


def _only_fine() -> Iterator[Element]:
    """Yield cubics by their middle root, odd or even powers with real exponents about their root, and rectified waves.

    As products or compositions of elements such shapes need more constants, or start too far from the data's rate.
    """
    for c in _inside(ALONE):
        for root in _in_proportion(ROOTS):
            yield Element("({q} - {a})*(square({q} - {a}) - {d})", lambda x: x * (x * x - 1.0), 1.0 / root, c)
        for p in EXPONENTS:
            odd, even = partial(lambda e, x: x * abs(x) ** e, p), partial(lambda e, x: abs(x) ** e, p + 1.0)
            yield Element(f"({{q}} - {{a}})*power(abs({{q}} - {{a}}), {p})", odd, c=c)
            yield Element(f"power(abs({{q}} - {{a}}), {p + 1.0})", even, c=c)
        for k in _in_proportion(TURNS, ALONE):
            yield Element("abs(sin({k}*({q} - {a})))", lambda x: np.abs(np.sin(x)), 0.5 * k, c)


class Elements:
    """Formula elements sorted by shape (text). every: all elements. first: position of each shape's first element."""

    def __init__(self, every: Iterable[Element]) -> None:
        numbers: dict[str, list[Element]] = {}
        for element in every:
            numbers.setdefault(element.text, []).append(element)
        self.every = tuple(chain.from_iterable(numbers.values()))
        self.texts = tuple(numbers)
        self.first = np.cumsum([0, *map(len, numbers.values())])[:-1]
        self._constants = np.array([(element.k, element.c) for element in self.every]).reshape(-1, 2)

    def of_text(self, text: int) -> slice:
        """Return the positions in `every` of the elements with shape number ``text``."""
        return slice(self.first[text], self.first[text + 1] if text + 1 < len(self.first) else len(self.every))

    def best(self, nats: Array, build: Callable[[int], Program]) -> Iterator["Trial"]:
        """Yield for each shape the element with the best constants. nats: approximate net gain of each element.
        build: function that makes the program of an element, by its position."""

        def of_text(text: int) -> Program:
            numbers = self.of_text(text)
            return build(numbers.start + int(np.argmax(nats[numbers])))

        for text, largest in enumerate(np.maximum.reduceat(nats, self.first).tolist()):
            yield Trial(largest, partial(of_text, text))

    def on_grid(self, columns: Array) -> Array:
        """Return the values (columns, elements, poses) of all elements at columns (columns, poses); none constant."""
        u = (columns - columns.min(axis=1, keepdims=True)) / np.ptp(columns, axis=1)[:, None]
        out = np.empty((len(columns), len(self.every), columns.shape[1]))
        for text in range(len(self.texts)):
            numbers = self.of_text(text)
            k, c = self._constants[numbers].T[:, :, None]
            out[:, numbers] = self.every[numbers.start].function(k * (u[:, None] - c))
        return out


def edges(column: Array) -> Elements:
    """Return a step between any two neighbouring values of an input with enough poses on either side."""
    u = np.sort((column - column.min()) / np.ptp(column))
    fewest = max(1, int(np.ceil(BESIDE_EDGE * len(u))))
    low, high = u[fewest - 1 : len(u) - fewest], u[fewest : len(u) - fewest + 1]
    middles = 0.5 * (low + high)[high > low]
    return Elements(Element(EDGE, lambda x: np.asarray(x > 0.0, dtype=float), c=c) for c in middles.tolist())


ELEMENTS, FINE = Elements(_elements()), Elements((*_elements(ALONE), *_only_fine()))
FAR = Elements(Element("square({q} - {a})", np.square, c=c) for d in OUTSIDE for c in (-d, 1.0 + d))
"""Squares of the distance to points outside an input's range, as arguments of elements: sine of a square, a chirp."""


@dataclass(frozen=True)
class Trial:
    """A formula before its constants are fitted. nats: approximate net gain of the formula, nats. build: function that
    makes the program."""

    nats: float
    build: Callable[[], Program]


def founders(name: str, column: Array, targets: Targets, most: int) -> list[Program]:
    """Return the ``most`` short forms of one input with the largest gain at the first site of `targets`, before
    constants are fitted.

    column: values (poses,) of the input. Of short forms that differ in constants alone only the best is returned. Short
    forms are compared on at most ``BINS`` values. A constant column has no short forms.
    """
    if not np.ptp(column):
        return []
    few, seen = binned(column, targets)
    of = partial(Element.program, inner=parse(repr(name)), low=float(few.min()), width=float(np.ptp(few)))
    found = list(_alone(FINE, few, seen, of))
    if (own := edges(column)).every:
        there = partial(Element.program, inner=parse(repr(name)), low=float(column.min()), width=float(np.ptp(column)))
        found += _alone(own, column, targets, there)
    alone = ELEMENTS.on_grid(few[None, :])[0]
    found += _products(alone, seen, of)
    found += _composed(ELEMENTS, {name: few}, seen, of)
    found += _composed(FAR, {name: few}, seen, of)
    return [trial.build() for trial in sorted(found, key=lambda trial: -trial.nats)[:most]]


def binned(column: Array, targets: Targets) -> tuple[Array, Targets]:
    """Return at most ``BINS`` values of an input, and the residual statistics (Targets) summed over the poses of each
    bin. A function that is constant over each bin has an equal gain at the bins and at the poses."""
    if len(column) <= BINS:
        return column, targets
    order = np.argsort(column, kind="stable")
    first = np.linspace(0, len(column), BINS, endpoint=False).astype(int)
    values = np.add.reduceat(column[order], first) / np.diff(first, append=len(column))
    sums = [np.add.reduceat(rows[..., order], first, axis=-1) for rows in (targets.weight, targets.cross, targets.pull)]
    weight, cross, pull = sums
    if cross.shape[1] > BINS:
        cross = np.linalg.qr(cross[0]).R[None]
    return values, replace(targets, weight=weight, cross=cross, pull=pull, samples=targets.components)


def _nats(values: Array, targets: Targets) -> Array:
    """Return the gain, nats, of each basis function. values: basis functions (..., poses)."""
    flat = values.reshape(-1, values.shape[-1])
    return fit_nats(targets.gains(flat), targets.components).reshape(values.shape[:-1])


def _alone(elements: Elements, column: Array, targets: Targets, of: Callable[[Element], Program]) -> Iterator[Trial]:
    """Yield for each element shape, such as a wave, the element with the best constants, as a short formula."""
    nats = _nats(elements.on_grid(column[None, :])[0], targets) - JOINED
    return elements.best(nats, lambda k: of(elements.every[k]))


def _products(alone: Array, targets: Targets, of: Callable[[Element], Program]) -> Iterator[Trial]:
    """Yield the product of two elements with the best constants, for every pair of shapes."""
    nats = np.full((len(alone), len(alone)), -np.inf)
    for one in range(len(alone)):
        nats[one, one:] = _nats(alone[one] * alone[one:], targets)

    def build(one: int, other: int) -> Program:
        return product_of(of(ELEMENTS.every[one]), of(ELEMENTS.every[other]))

    yield from _of_blocks(nats, ELEMENTS, build)


def _composed(
    inner: Elements, columns: dict[str, Array], targets: Targets, of: Callable[[Element], Program]
) -> Iterator[Trial]:
    """Yield the composition of two elements with the best constants, for every pair of shapes."""
    inside = inner.on_grid(np.array(list(columns.values())))[0]
    nats = np.full((len(inside), len(ELEMENTS.every)), -np.inf)
    varies = np.flatnonzero((np.ptp(inside, axis=1) > 0) & np.array([element.text != LINE for element in inner.every]))
    for some in np.array_split(varies, 1 + len(varies) * nats.shape[1] * inside.shape[1] // CHUNK):
        nats[some] = _nats(ELEMENTS.on_grid(inside[some]), targets)

    def build(one: int, other: int) -> Program:
        program = of(inner.every[one])
        values = program.evaluate(columns)[0]
        return ELEMENTS.every[other].program(program, float(values.min()), float(np.ptp(values)))

    yield from _of_blocks(nats, inner, build)


def _of_blocks(nats: Array, first: Elements, build: Callable[[int, int], Program]) -> Iterator[Trial]:
    """Yield the pair of elements with the best constants, for every pair of shapes. nats: gain of each pair, nats."""
    best = np.maximum.reduceat(np.maximum.reduceat(nats, first.first, axis=0), ELEMENTS.first, axis=1)
    for one, other in zip(*np.nonzero(best > 2.0 * JOINED), strict=True):
        rows, columns = first.of_text(one), ELEMENTS.of_text(other)
        block = nats[rows, columns]
        row, column = np.unravel_index(int(np.argmax(block)), block.shape)
        number = int(rows.start + row), int(columns.start + column)
        yield Trial(float(best[one, other]) - 2.0 * JOINED, partial(build, *number))


def product_of(first: Program, second: Program) -> Program:
    """Return the product of two programs, in which constants that only the grid makes equal are fitted separately."""
    apart = [value * APART if value in first.constants else value for value in second.constants]
    return combine("multiply", first, second.with_constants(apart))


def combine(operator: str, *programs: Program) -> Program:
    """Return an operator applied to programs that have one output each."""
    builder = Builder()
    return builder.program([builder.apply(operator, *(builder.copy(one)[one.outputs[0]] for one in programs))])
