"""Trees as DEAP objects with codes for the compiled loops; DEAP never compiles the trees."""

from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate, chain

import numpy as np
from deap import gp
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.evolution.code import Code
from gpmodel.evolution.forest import OWN_BYTE, OWN_CONSTANT, Forest
from gpmodel.evolution.machine import Layout


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


@dataclass(slots=True)
class Individual:
    """Several trees that are bred together. codes: prefix codes of the trees, one byte per node.

    The codes of a tree are empty until the tree is packed. A packed tree is never changed; variation works on a copy.
    """

    trees: tuple[gp.PrimitiveTree, ...]
    codes: tuple[bytes, ...] = field(default=(), compare=False)

    def replaced(self, place: int, tree: gp.PrimitiveTree) -> "Individual":
        """Return the individual with `tree` in the position ``place``; the codes of the other trees are kept."""
        trees, codes = [*self.trees], [*self.codes] or [b""] * len(self.trees)
        trees[place], codes[place] = tree, b""
        return Individual(tuple(trees), tuple(codes))

    @property
    def constants(self) -> list[float]:
        """Values of the constants that the individual carries, in depth-first order."""
        return [node.value for tree in self.trees for node in tree if node.code == OWN_BYTE]


@dataclass(frozen=True)
class Trees:
    """A population of individuals (several trees each). forest: codes of the trees for the compiled loops."""

    individuals: tuple[Individual, ...]

    def __len__(self) -> int:
        return len(self.individuals)

    @cached_property
    def forest(self) -> Forest:
        """Codes of all trees one after another, with the constants that each individual carries numbered in turn. Only
        new trees are packed; codes of trees from earlier populations are copied."""
        self._pack()
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

    def _pack(self) -> None:
        """Compute the codes of all trees that have none, in one pass."""
        bare = [one for one in self.individuals if not one.codes]
        some = [one for one in self.individuals if b"" in one.codes]
        holed = [(one, k) for one in some for k, code in enumerate(one.codes) if not code]
        trees = [*chain.from_iterable(one.trees for one in bare), *(one.trees[k] for one, k in holed)]
        ends = list(accumulate(map(len, trees)))
        packed = bytes([node.code for tree in trees for node in tree])
        codes = map(packed.__getitem__, map(slice, [0, *ends], ends))
        roots = len(self.individuals[0].trees)
        for one, made in zip(bare, zip(*[codes] * roots, strict=False), strict=False):
            one.codes = made
        for (one, k), code in zip(holed, codes, strict=True):
            one.codes = (*one.codes[:k], code, *one.codes[k + 1 :])

    def take(self, rows: NDArray[np.intp]) -> "Trees":
        return Trees(tuple(self.individuals[row] for row in rows))

    def join(self, other: "Trees") -> "Trees":
        return Trees(self.individuals + other.individuals)

    def decoded(self, layout: Layout, part: slice) -> Code:
        return self.forest.decoded(layout, part)

    def with_constants(self, row: int, values: Array) -> "Trees":
        remaining = iter(values.tolist())
        trees = []
        for tree in self.individuals[row].trees:
            copy = gp.PrimitiveTree(tree)
            for k, node in enumerate(tree):
                if node.code == OWN_BYTE:
                    own = object.__new__(ConstantNode)
                    own.value = next(remaining)
                    copy[k] = own
            trees.append(copy)
        return Trees((Individual(tuple(trees)),))
