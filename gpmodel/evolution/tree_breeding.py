"""Programs that are trees (Robertson 2003, 5.2.2, Fig 5.6), created and varied by the library DEAP.

DEAP uses Python's global random generator, which other threads may use too. Every call in this module replaces the
global generator by one seeded from the given NumPy generator. DEAP never compiles the trees; their nodes have codes for
the compiled loops. Kinds of quantities are enforced when a program is decoded, as for sequences: DEAP's typed sets need
one kind of result for every operator and a leaf of every kind, and no leaf is a squared angle.
"""

import random
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain

import numpy as np
from deap import gp
from numpy.typing import NDArray

from gpmodel.arrays import Array
from gpmodel.evolution.code import Code
from gpmodel.evolution.engine import empty_code
from gpmodel.evolution.machine import Layout

SHALLOW, DEEPEST_START = 1, 4
"""Smallest and largest depth of initial trees by ramped half-and-half (Koza 1992: 2 to 6, for larger populations)."""

OPERATOR_CODES = 32
"""First code of a tree node that is an input or a fixed constant; smaller codes are operators."""

OWN_CONSTANT = 16384
"""First code of a tree node that is one of the constants that a program carries. The code of the node itself stands for
each of them; ``Trees.forest`` adds the number of the constant."""

_ONE_AT_A_TIME = threading.Lock()
"""Lock held while DEAP runs, because all threads share its random generator."""


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
ConstantNode.code = OWN_CONSTANT

Individual = tuple[gp.PrimitiveTree, ...]
"""Trees that are bred together, one per output."""


@dataclass(frozen=True)
class Trees:
    """A population of individuals. Crossover and mutation work on copies of their trees."""

    individuals: tuple[Individual, ...]

    def __len__(self) -> int:
        return len(self.individuals)

    @cached_property
    def forest(self) -> tuple[NDArray[np.int16], NDArray[np.int32], Array]:
        """Prefix codes of all trees (one per node), bounds of the trees, and constants (programs, constants), padded.
        Tree k of program p is ``codes[bounds[p, k]:bounds[p, k + 1]]``. Constants of a program are numbered in turn."""
        trees = list(chain.from_iterable(self.individuals))
        nodes = list(chain.from_iterable(trees))
        codes = np.array([node.code for node in nodes], dtype=np.int16)
        ends = np.concatenate([[0], np.cumsum([len(tree) for tree in trees])])
        roots = len(trees) // len(self)
        bounds = ends[np.arange(len(self))[:, None] * roots + np.arange(roots + 1)]
        own = np.flatnonzero(codes == OWN_CONSTANT)
        row = np.searchsorted(bounds[:, 0], own, side="right") - 1
        number = np.arange(len(own)) - np.searchsorted(own, bounds[:, 0])[row]
        codes[own] += number.astype(np.int16)
        constants = np.zeros((len(self), int(number.max(initial=0)) + 1))
        constants[row, number] = [nodes[k].value for k in own.tolist()]
        return codes, bounds.astype(np.int32), constants

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


@contextmanager
def _deap_random(rng: np.random.Generator) -> Iterator[None]:
    own = random.Random(int(rng.integers(2**63)))
    with _ONE_AT_A_TIME:
        of_all, gp.random = gp.random, own
        try:
            yield
        finally:
            gp.random = of_all


def primitives_of(layout: Layout) -> gp.PrimitiveSet:
    """Return the operators and leaves of a layout as DEAP primitives."""
    primitives = gp.PrimitiveSet("program", 0)
    for operator in layout.operators:
        primitives._add(OperatorNode(operator.name, operator.arity, operator.code))
    leaves = [
        ElementNode(name, OPERATOR_CODES + row)
        for row, name in enumerate([*layout.inputs, *map(repr, layout.constants)])
    ]
    for leaf in (*leaves, *[ConstantNode] * layout.own_constants):
        primitives._add(leaf)
    primitives.prims_count, primitives.terms_count = len(layout.operators), len(leaves) + layout.own_constants
    return primitives


def random_trees(layout: Layout, depth: int, population: int, rng: np.random.Generator) -> Trees:
    """Return a population of trees by ramped half-and-half."""
    start = partial(gp.genHalfAndHalf, primitives_of(layout), SHALLOW, min(DEEPEST_START, depth))
    with _deap_random(rng):
        return Trees(tuple(tuple(gp.PrimitiveTree(start()) for _ in range(layout.outputs)) for _ in range(population)))


def children(
    layout: Layout, pairs: Iterable[Sequence[Individual]], depth: int, style: str, crossover: float,
    rng: np.random.Generator,
) -> Trees:  # fmt: skip
    """Return one child per pair of parents: the mother with one tree varied, unless that tree is deeper than ``depth``.
    style, crossover: settings as in ``Tree``."""
    primitives, koza, grown = primitives_of(layout), style == "koza", partial(gp.genFull, min_=0, max_=2)

    def varied(own: gp.PrimitiveTree, other: gp.PrimitiveTree) -> gp.PrimitiveTree:
        if gp.random.random() < crossover:
            return (gp.cxOnePoint(own, other) if koza else depth_first_crossover(own, other, primitives))[0]
        if gp.random.random() < 0.5:
            return (gp.mutUniform(own, grown, primitives) if koza else structure_mutation(own, other, primitives))[0]
        return gp.mutNodeReplacement(own, primitives)[0]

    def child(mother: Individual, father: Individual) -> Individual:
        place = gp.random.randrange(len(mother))
        own = gp.PrimitiveTree(mother[place])
        tree = varied(own, gp.PrimitiveTree(father[gp.random.randrange(len(father))]))
        is_too_deep = len(tree) > depth + 1 and tree.height > depth
        return mother if is_too_deep else (*mother[:place], tree, *mother[place + 1 :])

    with _deap_random(rng):
        return Trees(tuple(child(*pair) for pair in pairs))


def _complete(
    prefix: Sequence[gp.Primitive], supply: Iterator[gp.Primitive], primitives: gp.PrimitiveSet
) -> gp.PrimitiveTree:
    """Return the tree of ``prefix``, completed by nodes of ``supply``, or by random leaves if the supply ends."""
    nodes, missing, pending = [], 1, chain(prefix, supply)
    while missing > 0:
        node = next(pending, None)
        if node is None:
            node = gp.random.choice(primitives.terminals[object])
            node = node() if type(node) is gp.MetaEphemeral else node
        nodes.append(node)
        missing += node.arity - 1
    return gp.PrimitiveTree(nodes)


def depth_first_crossover(
    mother: gp.PrimitiveTree, father: gp.PrimitiveTree, primitives: gp.PrimitiveSet
) -> tuple[gp.PrimitiveTree]:
    """Return the mother's nodes up to a random point, then the father's nodes after it, in depth-first order (Fig 5.6).

    The father's nodes are used until the child is complete. If the father's nodes run out, or the father is shorter
    than the point, open arguments become random leaves.
    """
    point = gp.random.randrange(len(mother))
    return (_complete(mother[: point + 1], iter(father[point + 1 :]), primitives),)


def structure_mutation(
    mother: gp.PrimitiveTree, father: gp.PrimitiveTree, primitives: gp.PrimitiveSet
) -> tuple[gp.PrimitiveTree]:
    """Cross two trees with a separate crossover point in the father, so that sequences are reused elsewhere."""
    point = gp.random.randrange(len(mother))
    other = gp.random.randrange(len(father))
    return (_complete(mother[: point + 1], iter(father[other:]), primitives),)
