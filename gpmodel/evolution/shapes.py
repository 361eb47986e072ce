"""Short shapes of one input: an operator of it, an operator of that, a product of two, all looked at on a grid.

An element is an operator of k (u - c), u the input from 0 to 1 over the poses. Every element, every element of an
element and every product of two is compared by projection at a few k and c, some forty thousand, so that none of them
is missed by chance; their constants are fitted afterwards. An edge has no slope to fit its place by: it is looked for
between all neighbouring values.

Source: Bartlett, Desmond and Ferreira (2024), exhaustive symbolic regression.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property, partial
from itertools import combinations, product

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.evolution.description_length import fit_nats
from gpmodel.evolution.projection import Targets
from gpmodel.formula.operators import BY_NAME
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Program

INSIDE, OUTSIDE = (0.1, 0.9, 4), (0.02, 0.1, 0.4)
"""Places c, from one to another in so many steps; distances of poles and roots from the range, which start outside."""
STEEP, TURNS, GROWTH, WIDTHS = (2.0, 25.0, 2), (2.0, 24.0, 8), (1.5, 20.0, 2), (3.0, 8.0, 1)
"""Constants k of steps, of waves, of exponentials, and of bumps and resonances: from one to another, in so many."""
ROOTS = 0.1, 1.0, 8
"""Distances of the outer roots of a cubic from the middle one, from one to another in so many steps: of four steps a
plain cubic began so far off that two hundred other shapes were before it."""
EXPONENTS = (0.75, 1.25, 2.0)
"""Of the size of x in odd powers x |x|^p, in even ones one more, where they start."""
ALONE = 3
"""How many times finer these are of an element alone: a sine of another rate than the data's tells nothing."""
LINE = "({q} - {a})"
"""The element that is the input itself, from a place."""
EDGE, BESIDE_EDGE = "step({q} - {a})", 0.05
"""The element that sets in at once, and the share of the poses that it leaves at either side at least."""
JOINED = 4.0
"""Nats that an element has to gain, about its nodes and constants."""


@dataclass(frozen=True)
class Element:
    """A function of x = k (u - c). text: in the input's unit, {q} the input, {k} and {a} k and c; {b} is c + 1/k, {d}
    1/k², {e} -k²."""

    text: str
    function: Callable[[Array], Array]
    k: float = 1.0
    c: float = 0.0

    def written(self, text: str, values: Array) -> str:
        """Its text, of what has a text and values (N,)."""
        low, width = float(values.min()), float(np.ptp(values))
        ends = {
            "a": low + self.c * width,
            "b": low + (self.c + 1.0 / self.k) * width,
            "d": (width / self.k) ** 2,
            "e": -((self.k / width) ** 2),
        }
        numbers = {name: f"({end:.6g})" for name, end in ends.items()}
        return self.text.format(q=text, k=f"({self.k / width:.6g})", **numbers)


def _inside(finer: int) -> list[float]:
    """Places within the range."""
    first, last, steps = INSIDE
    return list(np.linspace(first, last, steps * finer + 1).tolist())


def _in_proportion(numbers: tuple[float, float, int], finer: int = 1) -> list[float]:
    """Numbers from one to another, each so many times the one before."""
    first, last, steps = numbers
    return list(np.geomspace(first, last, steps * finer + 1).tolist())


def _elements(finer: int = 1) -> Iterator[Element]:
    """Line, parabolas, kink, ramps, dead band, wave, steps, bump, resonance, growths, roots, logarithms, poles."""
    apply = {name: operator.function for name, operator in BY_NAME.items()}
    inside = _inside(finer)
    steep, turns, growth, widths = (_in_proportion(numbers, finer) for numbers in (STEEP, TURNS, GROWTH, WIDTHS))
    for c in inside:
        yield Element(LINE, lambda x: x, c=c)
        yield Element("square({q} - {a})", np.square, c=c)
        yield Element("abs({q} - {a})", np.abs, c=c)
        yield Element("({q} - {a})*sqrt(abs({q} - {a}))", lambda x: x * np.sqrt(np.abs(x)), c=c)
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
        yield Element(name + "({a} - {q})", partial(_of_opposite, apply[name]), 1.0, 1.0 + d)


def _cubics() -> Iterator[Element]:
    """Cubics by their middle root; among the products they are one of a parabola and a line, of more constants."""
    for c, root in product(_inside(ALONE), _in_proportion(ROOTS)):
        yield Element("({q} - {a})*(square({q} - {a}) - {d})", lambda x: x * (x * x - 1.0), 1.0 / root, c)


def _powers() -> Iterator[Element]:
    """Powers of any exponent, odd and even about their root."""
    for c, p in product(_inside(ALONE), EXPONENTS):
        yield Element(f"({{q}} - {{a}})*power(abs({{q}} - {{a}}), {p})", partial(_odd_power, p), c=c)
        yield Element(f"power(abs({{q}} - {{a}}), {p + 1.0})", partial(_even_power, p + 1.0), c=c)


def _odd_power(exponent: float, x: Array) -> Array:
    return np.asarray(x * np.abs(x) ** exponent)


def _even_power(exponent: float, x: Array) -> Array:
    return np.asarray(np.abs(x) ** exponent)


def _of_opposite(function: Callable[[Array], Array], x: Array) -> Array:
    return function(-x)


@dataclass(frozen=True)
class Elements:
    """Elements, those of one text together: all of them are computed at once, at their own k and c."""

    every: tuple[Element, ...]

    @cached_property
    def of_one_text(self) -> tuple[IntArray, ...]:
        """Numbers of the elements of each text, in the order in which the texts come first."""
        found: dict[str, list[int]] = {}
        for number, element in enumerate(self.every):
            found.setdefault(element.text, []).append(number)
        return tuple(np.array(numbers) for numbers in found.values())

    @cached_property
    def _constants(self) -> Array:
        return np.array([(element.k, element.c) for element in self.every]).reshape(-1, 2)

    def on_grid(self, column: Array) -> Array:
        """Values (E, N) over a column (N,) that varies."""
        u = (column - column.min()) / np.ptp(column)
        out = np.empty((len(self.every), len(column)))
        for numbers in self.of_one_text:
            k, c = self._constants[numbers].T[:, :, None]
            out[numbers] = self.every[numbers[0]].function(k * (u - c))
        return out


def edges(column: Array) -> Elements:
    """An edge half way between any two neighbouring values of a column (N,) that have enough poses at either side."""
    u = np.sort((column - column.min()) / np.ptp(column))
    fewest = max(1, int(np.ceil(BESIDE_EDGE * len(u))))
    low, high = u[fewest - 1 : len(u) - fewest], u[fewest : len(u) - fewest + 1]
    middles = 0.5 * (low + high)[high > low]
    return Elements(tuple(Element(EDGE, lambda x: np.asarray(x > 0.0, dtype=float), c=c) for c in middles.tolist()))


ELEMENTS, FINE = Elements(tuple(_elements())), Elements((*_elements(ALONE), *_cubics(), *_powers()))
FAR = Elements(tuple(Element("square({q} - {a})", np.square, c=c) for d in OUTSIDE for c in (-d, 1.0 + d)))
"""Squares from places outside the range, of which other elements are taken: a wave of one is a chirp."""


def shapes(name: str, column: Array, targets: Targets, most: int) -> list[Program]:
    """The shapes of a column (N,) of a name that gain most at the targets' first site from where they start.

    One of a kind: those that differ in constants alone count once.
    """
    found: dict[tuple[str, ...], tuple[float, Callable[[], str]]] = {}

    def look(
        values: Array, kind: Callable[[str], tuple[str, ...]], text: Callable[[Element], str], of: Elements = ELEMENTS
    ) -> None:
        gains = fit_nats(targets.gains(values)[:, 0], targets.components)
        for numbers in of.of_one_text:
            best = numbers[np.argmax(gains[numbers])]
            element = of.every[best]
            of_kind = kind(element.text)
            gain = float(gains[best]) - JOINED * len(of_kind)
            if gain > found.get(of_kind, (-np.inf,))[0]:
                found[of_kind] = gain, partial(text, element)

    def plain(element: Element) -> str:
        return element.written(repr(name), column)

    def multiplied(first: Element, second: Element) -> str:
        return f"{plain(first)}*{plain(second)}"

    @cache
    def values_of(text: str) -> Array:
        return np.asarray(parse(text).evaluate({name: column})[0])

    def composed(inner: Element, outer: Element) -> str:
        return outer.written(plain(inner), values_of(plain(inner)))

    for elements in (FINE, edges(column)):
        if elements.every:
            look(elements.on_grid(column), lambda text: (text,), plain, elements)
    alone = ELEMENTS.on_grid(column)
    for one, values in zip(ELEMENTS.every, alone, strict=True):
        look(alone * values, partial(_product_of, one.text), partial(multiplied, one))
    for inner, inside in ((ELEMENTS, alone), (FAR, FAR.on_grid(column))):
        for one, values in zip(inner.every, inside, strict=True):
            if one.text != LINE and np.ptp(values) > 0:
                kind = partial(_element_of, one.text if inner is ELEMENTS else "far " + one.text)
                look(ELEMENTS.on_grid(values), kind, partial(composed, one))
    best = sorted(found.values(), key=lambda shape: -shape[0])[:most]
    return [parse(text()) for _, text in best]


def _product_of(one: str, other: str) -> tuple[str, ...]:
    return tuple(sorted((one, other)))


def _element_of(inner: str, outer: str) -> tuple[str, ...]:
    return (outer, "of " + inner)
