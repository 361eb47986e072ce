"""Link functions that turn a response into a sum, whose coefficients are solved (McCullagh, Nelder 1989).

A formula ``y = inverse(c1 phi1 + c2 phi2 + ...)`` of the response y, with terms phi and coefficients c, is searched as
``forward(y) = c1 phi1 + c2 phi2 + ...``, with the link function ``forward`` and its inverse. Each point is weighted by
the ratio of an error of the response to an error of the link function.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from gpmodel.arrays import LARGEST, Array
from gpmodel.errors import InputError
from gpmodel.evolution.founders import combine
from gpmodel.evolution.projection import ROUNDING_SHARE, Targets
from gpmodel.formula.expression import parse, raise_to
from gpmodel.formula.operators import BY_NAME
from gpmodel.formula.program import Builder, Program

PRICE = 3.0
"""Penalty of a node or a constant of a formula, nats: the logarithm of some twenty operators and inputs."""
LARGEST_POWER = 8
"""Largest integer power that is written as a product."""


@dataclass(frozen=True)
class LinkFunction:
    """A link function of a response.

    operator, inverse: name of the link function and of its inverse; "" for the identity.
    with_inputs: True if every sum contains each input under the link function (power laws for the logarithm, squares
    for the square).
    quotient: True if terms phi may also enter a denominator: y (1 - sum b (phi - mean phi)) = sum c phi for the
    response y.
    """

    operator: str = ""
    inverse: str = ""
    with_inputs: bool = False
    quotient: bool = False

    def forward(self, response: Array) -> Array:
        """Return the value of the link function at each point of a response."""
        with np.errstate(all="ignore"):
            return BY_NAME[self.operator].function(response) if self.operator else response

    def applies(self, response: Array) -> bool:
        """Return whether the response can be recovered from its value under the link function."""
        one_sign = bool(np.all(response > 0) or np.all(response < 0))
        return self._varies(response) and (one_sign or self.operator != "square")

    def _varies(self, column: Array) -> bool:
        """Return whether the values of a column under the link function are different numbers that can be squared."""
        there = self.forward(column)
        return bool(np.abs(there).max() <= LARGEST and np.ptp(there) > 0)

    def root_weights(self, response: Array) -> Array:
        """Return the square roots of the weights of the points, the largest 1. An error e of the link function g(y) is
        an error e / g'(y) of the response y."""
        if not self.operator:
            return np.ones_like(response)
        root = 1.0 / np.abs(BY_NAME[self.operator].derivatives(response)[0])
        return np.asarray(root / root.max())

    def always(self, inputs: Mapping[str, Array]) -> list[Program]:
        """Return the terms of every sum: a constant and, with ``with_inputs``, each input under the link function.

        A constant input is no term of the sums. If the inputs are more than half as many as the table's rows, no input
        is one.
        """
        solvable = self.with_inputs and all(2 * len(inputs) <= len(column) for column in inputs.values())
        varying = (name for name, column in inputs.items() if solvable and self._varies(column))
        return [parse("1"), *(combine(self.operator, parse(repr(name))) for name in varying)]

    def targets(self, inputs: Mapping[str, Array], response: Array) -> Targets:
        """Return the response under the link function as one site, with the terms of every sum projected out."""
        root = self.root_weights(response)
        table = np.stack([root * term.evaluate(inputs)[0] for term in self.always(inputs)], axis=1)
        orthonormal, triangle = np.linalg.qr(table / np.abs(table).max(axis=0))
        orthonormal = orthonormal[:, np.abs(np.diag(triangle)) > 1e-9 * np.abs(triangle).max()]
        rest = root * self.forward(response)
        for _ in range(2):
            rest = rest - orthonormal @ (orthonormal.T @ rest)
        return Targets(
            np.square(root)[None], (root[:, None] * orthonormal).T[None], (root * rest)[None],
            max(float(rest @ rest), 1e-300), (self.operator,), len(response), ROUNDING_SHARE,
        )  # fmt: skip

    def formula(
        self, terms: Sequence[Program], inputs: Mapping[str, Array], response: Array, below: Sequence[Program] = ()
    ) -> Program | None:
        """Return the formula with given terms above and ``below`` the fraction bar, with coefficients by least squares.

        Terms that gain less than their penalty are omitted. An exponent becomes the nearest multiple of 1/2 if the
        penalty of a free exponent exceeds the loss; only then does the power of a negative number have a sign. Return
        None if no term remains or a column is not finite.
        """
        every = [*self.always(inputs), *terms]
        root, under = self.root_weights(response), [term.evaluate(inputs)[0] for term in below]
        columns = [*(term.evaluate(inputs)[0] for term in every), *below_the_bar(np.array(under), response)]
        table = root[:, None] * np.stack(columns, axis=1)
        if not np.isfinite(table).all():
            return None
        exponents = [self.operator == "log" and bool(term.inputs) for term in every]
        held = _solved(table, root * self.forward(response), [*exponents, *(False for _ in below)])
        above = [(term, held[k]) for k, term in enumerate(every) if held.get(k)]
        pairs = enumerate(zip(below, under, strict=True), len(every))
        divided = [(term, -held[k], float(values.mean())) for k, (term, values) in pairs if held.get(k)]
        with np.errstate(all="ignore"), suppress(InputError, ZeroDivisionError):
            return self._assembled(above, divided) if above else None
        return None

    def _assembled(
        self, terms: Sequence[tuple[Program, float]], below: Sequence[tuple[Program, float, float]]
    ) -> Program:
        if self.operator == "log":
            return _product(terms)
        if not below:
            return combine(self.inverse, summed(terms)) if self.inverse else summed(terms)
        one = 1.0 - sum(c * mean for _, c, mean in below)
        over = [(term, c / one) for term, c in terms]
        return combine("divide", summed(over), summed([(parse("1"), 1.0), *((term, c / one) for term, c, _ in below)]))


LINKS = (
    LinkFunction(),
    LinkFunction("log", "exp", with_inputs=True),
    LinkFunction("reciprocal", "reciprocal"),
    LinkFunction("square", "sqrt", with_inputs=True),
    LinkFunction(quotient=True),
)


def below_the_bar(values: Array, response: Array) -> Array:
    """Return the columns (..., points) of terms of a denominator, centred so that the mean of the denominator is 1."""
    with np.errstate(all="ignore"):
        return np.asarray((values - values.mean(axis=-1, keepdims=True)) * response) if values.size else values


def summed(terms: Sequence[tuple[Program, float]]) -> Program:
    """Return the sum of programs, each multiplied by its coefficient."""
    return reduce(lambda one, other: combine("add", one, other), (scaled(*term) for term in terms))


def _solved(table: Array, there: Array, exponents: Sequence[bool]) -> dict[int, float]:
    """Return {column of `table` (points, terms): coefficient}. A term is fitted if its gain exceeds its penalty. If
    there are more columns than points, the last columns are left out."""
    scale = np.abs(table).max(axis=0)
    free = np.flatnonzero(scale > 0)[: len(there) - 1].tolist()
    held: dict[int, float] = {}
    while free:
        part = table[:, free] / scale[free]
        rest = there - sum((table[:, k] * c for k, c in held.items()), np.zeros(len(there)))
        triangle = np.linalg.qr(part)[1]
        diagonal = np.abs(np.diag(triangle))
        if diagonal.min() <= 1e-10 * diagonal.max():
            free.pop(int(diagonal.argmin()))
            continue
        found = np.linalg.lstsq(part, rest, rcond=None)[0]
        coefficients = dict(zip(free, (found / scale[free]).tolist(), strict=True))
        powers = (exponents[k] and abs(c) <= LARGEST_POWER for k, c in coefficients.items())
        simple = np.where(list(powers), 0.5 * np.round(2.0 * np.array([*coefficients.values()])), 0.0)
        left = rest - part @ found
        floor = (1e-14 * np.abs(part) @ np.abs(found)).max() ** 2 * len(there)
        variances = np.square(np.linalg.inv(triangle)).sum(axis=1)
        moved = (found - simple * scale[free]) ** 2 / variances
        loss = 0.5 * len(there) * np.log1p(moved / max(float(left @ left), floor, 1e-300))
        worth = PRICE * np.where([exponents[k] for k in free], 5.0, 1.0)
        if (loss >= worth).all():
            return held | coefficients
        place = int(np.argmin(loss - worth))
        held[free.pop(place)] = float(simple[place])
    return held


def scaled(program: Program, factor: float) -> Program:
    """Return a program times a factor, which is merged with an existing factor and omitted if it is 1. A program
    without inputs counts as 1."""
    root = program.nodes[program.outputs[0]]
    if root.operator == "multiply" and program.nodes[root.arguments[0]].operator == "constant":
        factor *= float(program.nodes[root.arguments[0]].value or 0.0)
        program = replace(program, outputs=(root.arguments[1],)).select([0])
    number = exactly(factor)
    if not program.inputs:
        return number
    return program if number.constants == (1.0,) else combine("multiply", number, program)


def _product(terms: Sequence[tuple[Program, float]]) -> Program:
    """Return exp of a sum of terms; logarithms with multiples of 1/2 as coefficients become powers."""
    factors, level = [], 0.0
    for program, coefficient in terms:
        half, last = round(2.0 * coefficient), program.nodes[program.outputs[0]]
        if not program.inputs:
            level += coefficient
        elif last.operator == "log" and abs(2.0 * coefficient - half) < 1e-6 and 0 < abs(half) <= 2 * LARGEST_POWER:
            base = Builder(list(program.nodes)).program(last.arguments)
            factors.append(_power(base, half))
        else:
            factors.append(combine("exp", scaled(program, coefficient)))
    return reduce(lambda one, other: combine("multiply", one, other), [exactly(float(np.exp(level))), *factors])


def _power(base: Program, half: int) -> Program:
    """Return the program raised to the power half / 2."""
    builder = Builder()
    node = builder.copy(base)[base.outputs[0]]
    node = raise_to(builder, node if half % 2 == 0 else builder.apply("sqrt", node), abs(half) // (2 - half % 2))
    return builder.program([node if half > 0 else builder.apply("reciprocal", node)])


def exactly(value: float) -> Program:
    """Return a program that is a constant; a value within rounding of an integer becomes the integer."""
    whole = round(value) if abs(value) < 1e9 else 0
    builder = Builder()
    return builder.program([builder.constant(float(whole) if whole and abs(value / whole - 1.0) < 1e-9 else value)])
