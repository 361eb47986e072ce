"""Building blocks of a slot's program: elements, pairs of elements, and the pairs that explain most alone."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.evolution.description_length import gain_nats
from gpmodel.evolution.kinds import ANGLE, ANY, NONE, SHORT, Typing
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.rows import unit_rows
from gpmodel.formula.operators import BY_NAME, Operator
from gpmodel.formula.program import Builder, Node, Program

Rows = NDArray[np.intp]

TURNS = (2.0, 3.0)
"""Multiples of an angle among the pieces: gears and bearings err twice and three times a turn."""
SCREENED = 300
"""Pairs of pieces, the most promising by their nats, that are looked at whole."""


@dataclass(frozen=True)
class Pieces:
    """Pieces of programs (E of them): about how many nodes each adds (E,), its kind (E,), values, and how to build one.

    kinds: numbers of a ``Typing``, ``NONE`` for a piece that may not be. at: values (R, N) of pieces of some numbers
    (R,), ascending. build: from a builder, the copies of a program's nodes so far and the piece's number to its node.
    """

    growth: Array
    kinds: NDArray[np.uint8]
    at: Callable[[Rows], Array]
    build: Callable[[Builder, list[int], int], int]

    @cached_property
    def values(self) -> Array:
        """Values (E, N) of all."""
        return self.at(np.arange(len(self.growth)))

    @staticmethod
    def chained(parts: Sequence["Pieces"]) -> "Pieces":
        """Several one after another."""
        starts = np.cumsum([0, *(len(part.growth) for part in parts)])

        def at(rows: Rows) -> Array:
            cuts = np.searchsorted(rows, starts)
            some = [
                part.at(rows[begin:end] - start)
                for part, start, begin, end in zip(parts, starts, cuts, cuts[1:], strict=False)
                if begin < end
            ]
            return np.concatenate(some) if some else parts[0].at(rows)

        def build(builder: Builder, copies: list[int], k: int) -> int:
            part = int(np.searchsorted(starts, k, side="right")) - 1
            return parts[part].build(builder, copies, k - int(starts[part]))

        growth, kinds = (np.concatenate([getattr(p, name) for p in parts]) for name in ("growth", "kinds"))
        return Pieces(growth, kinds, at, build)

    def of_kinds(self, kinds: Sequence[int]) -> "Pieces":
        """Blocks of some kinds."""
        wanted = np.zeros(NONE + 1, dtype=bool)
        wanted[list(kinds)] = True
        rows = np.flatnonzero(wanted[self.kinds])

        def build(builder: Builder, copies: list[int], k: int) -> int:
            return self.build(builder, copies, int(rows[k]))

        return Pieces(self.growth[rows], self.kinds[rows], lambda some: self.at(rows[some]), build)


@dataclass(frozen=True)
class Vocabulary:
    """Inputs, one-argument operators of inputs, sines and cosines of multiples of angles; constants; the operators."""

    inputs: Inputs
    operators: tuple[Operator, ...]
    constants: tuple[float, ...] = ()

    @cached_property
    def typing(self) -> Typing:
        """The rules of kinds over these inputs."""
        return Typing(self.inputs.kinds)

    @cached_property
    def unary(self) -> tuple[Operator, ...]:
        """Its operators of one argument."""
        return tuple(o for o in self.operators if o.arity == 1)

    @cached_property
    def binary(self) -> tuple[Operator, ...]:
        """Its operators of two arguments."""
        return tuple(o for o in self.operators if o.arity == 2)

    @cached_property
    def elements(self) -> Pieces:
        """The programs that a tree's leaves are drawn from, with their kinds."""
        programs, kinds = [], []
        for program in self._elements():
            kind = self.typing.of_nodes(program, self.inputs.names)[-1]
            if kind != NONE:
                programs.append(program)
                kinds.append(kind)
        with np.errstate(all="ignore"):
            values = np.vstack([program.evaluate(self.inputs.mapping()) for program in programs])
        sizes = np.array([program.complexity for program in programs], dtype=float)
        numbers = np.array(kinds, dtype=np.uint8)

        def build(builder: Builder, copies: list[int], k: int) -> int:
            return builder.copy(programs[k])[programs[k].outputs[0]]

        return Pieces(sizes, numbers, values.__getitem__, build)

    def _elements(self) -> Iterator[Program]:
        for value in self.constants:
            builder = Builder()
            yield builder.program([builder.constant(value)])
        kinds = self.inputs.kinds or (ANY,) * len(self.inputs.names)
        for name, kind in zip(self.inputs.names, kinds, strict=True):
            builder = Builder()
            plain = builder.input(name)
            yield builder.program([plain])
            for operator in self.unary:
                yield builder.program([builder.apply(operator.name, plain)])
                if kind in (ANGLE, SHORT) and operator.name in ("sin", "cos"):
                    for turns in TURNS:
                        argument = builder.apply("multiply", builder.constant(turns), plain)
                        yield builder.program([builder.apply(operator.name, argument)])

    def pairs(self) -> Pieces:
        """All products of two elements, and all one-argument operators of a sum or a difference of two inputs."""
        return Pieces.chained([self._products(), *self._combined()]).of_kinds(range(NONE))

    def _products(self) -> Pieces:
        elements = self.elements
        first, second = np.triu_indices(len(elements.values), 1)

        def build(builder: Builder, copies: list[int], k: int) -> int:
            return builder.apply("multiply", *(elements.build(builder, copies, int(i[k])) for i in (first, second)))

        sizes = elements.growth[first] + elements.growth[second] + 1.0
        kinds = self.typing.of(BY_NAME["multiply"], elements.kinds[first], elements.kinds[second])

        def at(rows: Rows) -> Array:
            return elements.values[first[rows]] * elements.values[second[rows]]

        return Pieces(sizes, kinds, at, build)

    def _combined(self) -> Iterator[Pieces]:
        names, values = self.inputs.names, self.inputs.values
        first, second = np.triu_indices(len(names), 1)

        here = self.typing.of_nodes(Program(tuple(Node("input", (), name) for name in names), ()), names)
        numbers = np.array(here, dtype=np.uint8)

        def combined(join: str, rows: Array, operator: Operator) -> Pieces:
            def build(builder: Builder, copies: list[int], k: int) -> int:
                joined = builder.apply(join, *(builder.input(names[i[k]]) for i in (first, second)))
                return builder.apply(operator.name, joined)

            kinds = self.typing.of(operator, self.typing.of(BY_NAME[join], numbers[first], numbers[second]))
            return Pieces(np.full(len(rows), 4.0), kinds, lambda some: operator.function(rows[some]), build)

        for join, sign in (("add", 1.0), ("subtract", -1.0)):
            for operator in self.unary:
                yield combined(join, values[first] + sign * values[second], operator)


def promising(problem: SlotProblem, words: Vocabulary, count: int) -> tuple[tuple[Program, int], ...]:
    """The best pairs of the vocabulary and the site of each.

    Neither of two factors alone need explain anything, so that evolution has no slope to follow. All pairs are ranked
    by what they explain at least, the first few hundred then by what they do explain.
    """
    targets = problem.targets
    with np.errstate(all="ignore"):
        pairs = words.pairs()
        rows = unit_rows(pairs.values)
        least = np.max((rows @ targets.pull.T) ** 2 / np.maximum(rows**2 @ targets.weight.T, 1e-300), axis=1)
    few = np.argsort(-problem.nats(least / targets.energy, pairs.growth), kind="stable")[:SCREENED]
    gains = targets.gains(pairs.values[few])
    found = []
    for k in np.argsort(-problem.nats(gains.max(axis=1), pairs.growth[few]), kind="stable")[:count].tolist():
        builder = Builder()
        found.append((builder.program([pairs.build(builder, [], int(few[k]))]), int(gain_nats(gains[k]).argmax())))
    return tuple(found)
