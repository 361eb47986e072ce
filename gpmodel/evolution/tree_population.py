"""Trees as DEAP objects with codes for the compiled loops; DEAP never compiles the trees."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np
from deap import gp
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.evolution.code import Code
from gpmodel.evolution.engine import empty_code
from gpmodel.evolution.machine import Layout

OPERATOR_CODES = 32
"""First code of a tree node that is an input or a fixed constant; smaller codes are operators."""

OWN_CONSTANT = 16384
"""First code of a tree node that is one of the constants that a program carries."""

OWN_BYTE = 255
"""Byte that stands for each constant of a program in a packed tree (one byte per node)."""


class OperatorNode(gp.Primitive):
    """An operator in a tree, with its op-code for the compiled loops."""

    __slots__ = ("code",)

    def __init__(self, name: str, arity: int, code: int) -> None:
        super().__init__(name, [object] * arity, object)
        self.code = code


class ElementNode(gp.Terminal):
    """A leaf of a tree, with its number for the compiled loops."""

    __slots__ = ("code",)

    def __init__(self, name: str, code: int) -> None:
        super().__init__(name, True, object)
        self.code = code


def _standard_normal() -> float:
    return float(gp.random.gauss(0.0, 1.0))


ConstantNode = gp.MetaEphemeral("constant", _standard_normal, object)
ConstantNode.code = OWN_BYTE


@dataclass(frozen=True)
class Individual:
    """Several trees that are bred together. codes: prefix codes of the trees, one byte per node. Crossover and mutation
    work on copies of the trees."""

    trees: tuple[gp.PrimitiveTree, ...]
    codes: tuple[bytes, ...]

    @staticmethod
    def of(trees: Iterable[gp.PrimitiveTree]) -> "Individual":
        """Return the individual that consists of the given trees."""
        every = tuple(trees)
        return Individual(every, tuple(map(_packed, every)))

    def replaced(self, place: int, tree: gp.PrimitiveTree) -> "Individual":
        """Return the individual with `tree` in the position ``place``; the codes of the other trees are kept."""
        trees, codes = [*self.trees], [*self.codes]
        trees[place], codes[place] = tree, _packed(tree)
        return Individual(tuple(trees), tuple(codes))

    @property
    def constants(self) -> list[float]:
        """Values of the constants that the individual carries, in depth-first order."""
        return [node.value for tree in self.trees for node in tree if node.code == OWN_BYTE]


def _packed(tree: gp.PrimitiveTree) -> bytes:
    return bytes([node.code for node in tree])


class Forest(NamedTuple):
    """Programs of several trees each, as flat prefix codes (one code per node).

    Tree k of program p is ``codes[bounds[p, k]:bounds[p, k + 1]]``. constants: (programs, constants) of each, padded.
    """

    codes: NDArray[np.int16]
    bounds: NDArray[np.int32]
    constants: Array


@dataclass(frozen=True)
class Trees:
    """A population of individuals (several trees each)."""

    individuals: tuple[Individual, ...]

    def __len__(self) -> int:
        return len(self.individuals)

    @cached_property
    def forest(self) -> Forest:
        """Codes of all trees one after another, with the constants that each individual carries numbered in turn."""
        parts = list(chain.from_iterable(individual.codes for individual in self.individuals))
        packed = np.frombuffer(b"".join(parts), np.uint8)
        codes = packed.astype(np.int16)
        ends = np.concatenate([[0], np.cumsum(np.fromiter(map(len, parts), np.int64, len(parts)))])
        roots = len(parts) // len(self)
        bounds = ends[np.arange(len(self))[:, None] * roots + np.arange(roots + 1)]
        own = np.flatnonzero(packed == OWN_BYTE)
        first = np.searchsorted(own, bounds[:, 0])
        row = np.searchsorted(bounds[:, 0], own, side="right") - 1
        number = np.arange(len(own)) - first[row]
        codes[own] = OWN_CONSTANT + number
        constants = np.zeros((len(self), int(number.max(initial=0)) + 1))
        if len(own):
            nodes = list(chain.from_iterable(tree for individual in self.individuals for tree in individual.trees))
            constants[row, number] = [nodes[k].value for k in own.tolist()]
        return Forest(codes, bounds.astype(np.int32), constants)

    def take(self, rows: NDArray[np.intp]) -> "Trees":
        return Trees(tuple(self.individuals[row] for row in rows))

    def join(self, other: "Trees") -> "Trees":
        return Trees(self.individuals + other.individuals)

    def decoded(self, layout: Layout, part: slice) -> Code:
        from gpmodel.evolution.kernels.batch import decode_forest

        codes, bounds, constants = self.forest
        longest = int(np.max(bounds[part, -1] - bounds[part, 0]))
        code = empty_code(np.ascontiguousarray(constants[part]), longest, layout.outputs)
        decode_forest(codes, bounds[part], layout.tables, code)
        return code
