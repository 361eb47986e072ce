"""Links: what of a response is a sum of terms, so that their coefficients can be solved (McCullagh, Nelder 1989).

A law ``y = inverse(c1 phi1 + c2 phi2 + ...)`` is searched as ``forward(y) = c1 phi1 + c2 phi2 + ...``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial, reduce

import numpy as np

from gpmodel.arrays import Array
from gpmodel.formula.operators import BY_NAME
from gpmodel.formula.program import Builder, Program

POWER, BROKEN_POWER = 2, 5
"""Nodes that an input adds to a product; nodes and constants more of a power that is no multiple of a half:
exp(c log x) in place of x."""

FITS = 3
"""Solutions of a weighted link, each at the fit before: a fourth changes hardly any, even if much lies below noise."""

LARGEST_POWER = 8
"""Whole powers up to this one are written as products."""


@dataclass(frozen=True)
class Link:
    """The operator of a response (N,) that makes it a sum, and the one that makes the sum a response again.

    "" for none. with_inputs: whether the inputs under the same operator are terms of every sum: powers under the
    logarithm, squares under the square. logarithms: whether those of a program's outputs are offered beside them.
    quotient: whether outputs are offered as terms of a denominator too, which multiply the response:
    y (1 - sum b phi) = sum c phi. weighted: whether points count by what an error of the link does to the response,
    as noise asks for; otherwise all alike.
    """

    name: str
    operator: str = ""
    inverse: str = ""
    with_inputs: bool = False
    logarithms: bool = False
    quotient: bool = False
    weighted: bool = False

    def forward(self, response: Array) -> Array:
        """The response (N,) as the sum that it is."""
        with np.errstate(all="ignore"):
            return BY_NAME[self.operator].function(response) if self.operator else response

    def applies(self, response: Array) -> bool:
        """Whether the response can be recovered from its link."""
        there = self.forward(response)
        if not np.all(np.isfinite(there)) or np.ptp(there) <= 0:
            return False
        if self.operator == "square":
            return bool(np.all(response > 0) or np.all(response < 0))
        return self.operator != "sin" or bool(np.abs(response).max() <= np.pi / 2)

    def root_weights(self, response: Array) -> Array:
        """What each point's error under the link is multiplied by (N,), the largest 1.

        An error e of the response is g'(y) e under the link g, so that its weight is 1 / g'(y)² (the generalized linear
        model's, at the response itself).
        """
        if not self.weighted:
            return np.ones_like(response)
        root = 1.0 / np.abs(BY_NAME[self.operator].derivatives(response)[0])
        return np.asarray(root / root.max())

    def at_fit(self, response: Array, linked: Array) -> tuple[Array, Array]:
        """Roots of weights (N,), the largest 1, and the response to solve for (N,) at a fit of the linked response.

        Fisher scoring of the generalized linear model under the logarithm, the response's sign given: with fits m,
        weights m² and response log m + (|y| - m) / m.
        """
        fit = np.exp(linked - linked.max())
        size = np.abs(response) * np.exp(-linked.max())
        return fit, linked + (size - fit) / fit

    def always(self, inputs: Mapping[str, Array]) -> list["LinkTerm"]:
        """Terms of every sum: one, and where it is said so each input under the same operator."""
        builder = Builder()
        nodes = [builder.constant(1.0)]
        for name, column in inputs.items():
            if self.with_inputs and np.all(np.isfinite(self.forward(column))):
                nodes.append(builder.apply(self.operator, builder.input(name)))
        return [LinkTerm(builder.program([node])) for node in nodes]

    def simplest(self, term: Program, coefficient: float) -> float:
        """The coefficient nearest to a term's that is no constant: 0, or the multiple of a half, of an exponent."""
        is_exponent = self.logarithms and bool(term.inputs)
        return 0.5 * round(2.0 * coefficient) if is_exponent and abs(coefficient) <= LARGEST_POWER else 0.0

    def companions(self, values: Array, response: Array) -> Array:
        """What is offered beside outputs (P, m, N): (P, m, N), or (P, 0, N)."""
        with np.errstate(all="ignore"):
            if self.logarithms:
                return np.log(np.abs(values))
            if self.quotient:
                return below_the_bar(values, response)
        return values[:, :0]


def below_the_bar(values: Array, response: Array) -> Array:
    """Columns (..., N) of terms of a denominator.

    They are centred: a denominator whose mean over the points is 1 cannot make all errors small. (It can most, so that
    laws are judged by what they leave of the response itself.)
    """
    with np.errstate(all="ignore"):
        return np.asarray((values - values.mean(axis=-1, keepdims=True)) * response)


LINKS = (
    Link("logarithm", "log", "exp", with_inputs=True, logarithms=True),
    Link("weighted logarithm", "log", "exp", with_inputs=True, logarithms=True, weighted=True),
    Link("identity"),
    Link("quotient", quotient=True),
    Link("reciprocal", "reciprocal", "reciprocal"),
    Link("square", "square", "sqrt", with_inputs=True),
    Link("sine", "sin", "asin"),
)


@dataclass(frozen=True)
class LinkTerm:
    """A one-output program in a sum, or, below the bar of a quotient, in the denominator."""

    program: Program
    below: bool = False

    def column(self, columns: Mapping[str, Array], response: Array) -> Array:
        """Its values (N,) in the linear problem of the coefficients."""
        values = self.program.evaluate(columns)[0]
        return below_the_bar(values, response) if self.below else values

    def values_below(self, columns: Mapping[str, Array], points: int) -> Array:
        """What it is worth below the bar (N,): 0 where it stands above."""
        return self.program.evaluate(columns)[0] if self.below else np.zeros(points)


def assembled(terms: list[LinkTerm], coefficients: list[float], link: Link) -> Program:
    """The law of terms with their coefficients: their sum, product or quotient under the inverse of the link."""
    builder = Builder()
    above = [(t.program, c) for t, c in zip(terms, coefficients, strict=True) if not t.below]
    below = [(t.program, -c) for t, c in zip(terms, coefficients, strict=True) if t.below]
    if link.logarithms:
        return builder.program([_product(builder, above)])
    node = _sum(builder, above)
    if below:
        below.append((_one(), 1.0))
        node = builder.apply("divide", node, _sum(builder, below))
    return builder.program([builder.apply(link.inverse, node) if link.inverse else node])


def _one() -> Program:
    builder = Builder()
    return builder.program([builder.constant(1.0)])


def _sum(builder: Builder, terms: list[tuple[Program, float]]) -> int:
    """The node of a sum; a program that reads no input stands for 1."""
    total: int | None = None
    for program, coefficient in terms:
        number = builder.constant(_tidy(coefficient))
        node = number
        if program.inputs:
            node = builder.copy(program)[program.outputs[0]]
            node = node if _tidy(coefficient) == 1.0 else builder.apply("multiply", number, node)
        total = node if total is None else builder.apply("add", total, node)
    return builder.constant(0.0) if total is None else total


def _product(builder: Builder, terms: list[tuple[Program, float]]) -> int:
    """exp of a sum, its logarithms written as powers where the exponent is a multiple of a half."""
    factors: list[int] = []
    constant = 0.0
    for program, coefficient in terms:
        if not program.inputs:
            constant += coefficient
            continue
        copies = builder.copy(program)
        last = program.nodes[program.outputs[0]]
        half = round(2.0 * coefficient)
        if last.operator == "log" and abs(2.0 * coefficient - half) < 1e-6 and 0 < abs(half) <= 2 * LARGEST_POWER:
            factors.append(_power(builder, copies[last.arguments[0]], half))
        else:
            scaled = builder.apply("multiply", builder.constant(_tidy(coefficient)), copies[program.outputs[0]])
            factors.append(builder.apply("exp", scaled))
    number = builder.constant(_tidy(float(np.exp(constant))))
    return builder.apply("multiply", number, reduce(partial(builder.apply, "multiply"), factors)) if factors else number


def _power(builder: Builder, base: int, half: int) -> int:
    """``base`` to the power of half of a whole number."""
    from gpmodel.formula.parse import raise_to

    node = raise_to(builder, base if half % 2 == 0 else builder.apply("sqrt", base), abs(half) // (2 - half % 2))
    return node if half > 0 else builder.apply("reciprocal", node)


def _tidy(value: float) -> float:
    """Without the rounding that solving leaves of a whole number."""
    whole = round(value) if abs(value) < 1e9 else 0
    return float(whole) if whole and abs(value - whole) < 1e-11 * abs(whole) else value
