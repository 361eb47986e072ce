"""Binary trees (thesis section 5.2.2, Fig 5.6), bred by DEAP; the only module that imports it.

DEAP draws from Python's global generator: every call here seeds it from the NumPy generator it is given and
puts its state back. Trees are never compiled by DEAP: each becomes a run of prefix codes for the kernels.
"""

import random
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain
from operator import attrgetter

import numpy as np
from deap import base, gp
from numpy.typing import NDArray

from gpmodel.evolution.machine import Layout
from gpmodel.evolution.population import OPERATOR_CODES, OWN_CONSTANT, Forest
from gpmodel.formula.operators import BY_CODE
from gpmodel.formula.program import Builder, Program

Array = NDArray[np.float64]


class _Operator(gp.Primitive):
    __slots__ = ("code",)

    def __init__(self, name: str, arity: int, code: int) -> None:
        super().__init__(name, [object] * arity, object)
        self.code = code


class _Element(gp.Terminal):
    __slots__ = ("code",)

    def __init__(self, name: str, code: int) -> None:
        super().__init__(name, True, object)
        self.code = code


def _standard_normal() -> float:
    return random.gauss(0.0, 1.0)


_OwnConstant = gp.MetaEphemeral("constant", _standard_normal, object)
_OwnConstant.code = OWN_CONSTANT
_CODE = attrgetter("code")


@contextmanager
def _deap_random(rng: np.random.Generator) -> Iterator[None]:
    state = random.getstate()
    random.seed(int(rng.integers(2**63)))
    try:
        yield
    finally:
        random.setstate(state)


@dataclass(frozen=True)
class Individual:
    """Several trees bred together, with their codes; own constants in the order of the codes."""

    trees: tuple[gp.PrimitiveTree, ...]

    @cached_property
    def codes(self) -> NDArray[np.int16]:
        """Prefix codes of all trees, own constants numbered in turn."""
        codes = np.fromiter(map(_CODE, chain.from_iterable(self.trees)), np.int16)
        own = codes == OWN_CONSTANT
        if own.any():
            codes[own] += np.arange(np.count_nonzero(own), dtype=np.int16)
        return codes

    @cached_property
    def constants(self) -> list[float]:
        """Values of the own constants, in the order of the codes."""
        if self.codes.max() < OWN_CONSTANT:
            return []
        return [node.value for tree in self.trees for node in tree if node.code == OWN_CONSTANT]


@dataclass(frozen=True)
class Trees:
    """A population of individuals; ``forest`` is what the kernels read."""

    individuals: tuple[Individual, ...]

    def __len__(self) -> int:
        return len(self.individuals)

    @cached_property
    def forest(self) -> Forest:
        lengths = np.array([[0, *map(len, individual.trees)] for individual in self.individuals])
        sizes = lengths.sum(axis=1)
        starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])
        most = max(1, max(len(individual.constants) for individual in self.individuals))
        constants = np.zeros((len(self), most))
        for row, individual in zip(constants, self.individuals, strict=True):
            row[: len(individual.constants)] = individual.constants
        codes = np.concatenate([individual.codes for individual in self.individuals])
        return Forest(codes, (starts[:, None] + lengths.cumsum(axis=1)).astype(np.int32), constants)

    def take(self, rows: NDArray[np.intp]) -> "Trees":
        return Trees(tuple(self.individuals[row] for row in rows))

    def join(self, other: "Trees") -> "Trees":
        return Trees(self.individuals + other.individuals)

    def constants_of(self, row: int) -> Array:
        """Own constants of one individual."""
        return np.array(self.individuals[row].constants)

    def with_constants(self, row: int, values: Array) -> "Trees":
        """The one individual at ``row`` with other own constants."""
        remaining = iter(values.tolist())
        trees = []
        for tree in self.individuals[row].trees:
            copy = gp.PrimitiveTree(tree)
            for k, node in enumerate(tree):
                if node.code == OWN_CONSTANT:
                    own = _OwnConstant()
                    own.value = next(remaining)
                    copy[k] = own
            trees.append(copy)
        return Trees((Individual(tuple(trees)),))


@dataclass(frozen=True)
class TreeBreeding:
    """How trees are made and varied.

    ``style`` is "koza" (subtree exchange, grown subtrees, node replacement) or "thesis" (the depth-first
    crossover and the two mutations of section 5.2.2, completed so that a tree is always whole). Starts are
    ramped half-and-half between ``shallow`` and ``start_depth``; no tree grows deeper than ``depth``.
    """

    layout: Layout
    style: str = "koza"
    depth: int = 12
    shallow: int = 1
    start_depth: int = 4
    crossover: float = 0.6

    @cached_property
    def primitives(self) -> gp.PrimitiveSet:
        layout = self.layout
        primitives = gp.PrimitiveSet("program", 0)
        for operator in layout.operators:
            primitives._add(_Operator(operator.name, operator.arity, operator.code))
            primitives.prims_count += 1
        names = [*layout.inputs, *map(repr, layout.constants)]
        for row, name in enumerate(names):
            primitives._add(_Element(name, OPERATOR_CODES + row))
            primitives.terms_count += 1
        for _ in range(layout.own_constants):
            primitives._add(_OwnConstant)
            primitives.terms_count += 1
        return primitives

    @cached_property
    def toolbox(self) -> base.Toolbox:
        toolbox = base.Toolbox()
        toolbox.register("start", gp.genHalfAndHalf, pset=self.primitives, min_=self.shallow, max_=self.start_depth)
        toolbox.register("grown", gp.genFull, min_=0, max_=2)
        if self.style == "koza":
            toolbox.register("mate", gp.cxOnePoint)
            toolbox.register("mutate_structure", gp.mutUniform, expr=toolbox.grown, pset=self.primitives)
        else:
            toolbox.register("mate", partial(depth_first_crossover, primitives=self.primitives))
            toolbox.register("mutate_structure", partial(structure_mutation, primitives=self.primitives))
        toolbox.register("mutate_operator", gp.mutNodeReplacement, pset=self.primitives)
        return toolbox

    def initial(self, population: int, rng: np.random.Generator) -> Trees:
        """A random population."""
        with _deap_random(rng):
            return Trees(
                tuple(
                    Individual(tuple(gp.PrimitiveTree(self.toolbox.start()) for _ in range(self.layout.outputs)))
                    for _ in range(population)
                )
            )

    def offspring(
        self, parents: Trees, mothers: NDArray[np.intp], fathers: NDArray[np.intp], rng: np.random.Generator
    ) -> Trees:
        """One child a pair of parents, by crossover or one of the mutations."""
        children = []
        with _deap_random(rng):
            for mother, father in zip(mothers.tolist(), fathers.tolist(), strict=True):
                children.append(self._child(parents.individuals[mother], parents.individuals[father]))
        return Trees(tuple(children))

    def _child(self, mother: Individual, father: Individual) -> Individual:
        place = random.randrange(len(mother.trees))
        own = gp.PrimitiveTree(mother.trees[place])
        other = gp.PrimitiveTree(father.trees[random.randrange(len(father.trees))])
        toolbox = self.toolbox
        if random.random() < self.crossover:
            child = toolbox.mate(own, other)[0]
        elif self.style == "thesis":
            child = (
                toolbox.mutate_structure(own, other)[0] if random.random() < 0.5 else toolbox.mutate_operator(own)[0]
            )
        elif random.random() < 0.5:
            child = toolbox.mutate_structure(own)[0]
        else:
            child = toolbox.mutate_operator(own)[0]
        if child.height > self.depth:
            return mother
        return Individual((*mother.trees[:place], child, *mother.trees[place + 1 :]))


def _complete(
    prefix: Sequence[gp.Primitive], supply: Iterator[gp.Primitive], primitives: gp.PrimitiveSet
) -> gp.PrimitiveTree:
    """``prefix``, then nodes of ``supply`` until the tree is whole; random leaves where the supply ends."""
    nodes = []
    missing = 1
    for node in prefix:
        nodes.append(node)
        missing += node.arity - 1
    while missing > 0:
        node = next(supply, None)
        if node is None:
            node = random.choice(primitives.terminals[object])
            node = node() if type(node) is gp.MetaEphemeral else node
        nodes.append(node)
        missing += node.arity - 1
    return gp.PrimitiveTree(nodes)


def depth_first_crossover(
    mother: gp.PrimitiveTree, father: gp.PrimitiveTree, primitives: gp.PrimitiveSet
) -> tuple[gp.PrimitiveTree]:
    """Fig 5.6: the mother's nodes up to a point, then the father's after it, in depth-first order.

    The father's nodes are used until the child is whole; where they run out, or he is shorter than the
    point, the open places become random leaves.
    """
    point = random.randrange(len(mother))
    return (_complete(mother[: point + 1], iter(father[point + 1 :]), primitives),)


def structure_mutation(
    mother: gp.PrimitiveTree, father: gp.PrimitiveTree, primitives: gp.PrimitiveSet
) -> tuple[gp.PrimitiveTree]:
    """The same with a crossover point of its own in the father, so that sequences are reused elsewhere."""
    point = random.randrange(len(mother))
    other = random.randrange(len(father))
    return (_complete(mother[: point + 1], iter(father[other:]), primitives),)


def program_of(individual: Individual, layout: Layout) -> Program:
    """The trees of an individual as one Program, one output a tree."""
    builder = Builder()

    def leaf(node: gp.Terminal) -> int:
        if node.code == OWN_CONSTANT:
            return builder.constant(node.value)
        row = node.code - OPERATOR_CODES
        if row < len(layout.inputs):
            return builder.input(layout.inputs[row])
        return builder.constant(layout.constants[row - len(layout.inputs)])

    outputs = []
    for tree in individual.trees:
        stack: list[int] = []
        for node in reversed(tree):
            if node.arity == 0:
                stack.append(leaf(node))
            else:
                arguments = [stack.pop() for _ in range(node.arity)]
                stack.append(builder.apply(BY_CODE[node.code].name, *arguments))
        outputs.append(stack[0])
    return builder.program(outputs)
