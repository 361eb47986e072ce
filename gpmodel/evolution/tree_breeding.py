"""Creation and variation of trees (thesis section 5.2.2, Fig 5.6), by DEAP.

DEAP draws from Python's generator, and so may any other thread: every call here puts one of its own in the place where
DEAP looks for it, seeded from the NumPy generator it is given.

Kinds rule trees where they rule sequences, when a program is decoded: DEAP's typed sets want one kind of result for
every operator and a leaf of every kind, and no leaf is a squared angle.
"""

import random
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from deap import base, gp
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.evolution.forest import OPERATOR_CODES, OWN_BYTE
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.representation import Population
from gpmodel.evolution.tree_population import ConstantNode, ElementNode, Individual, OperatorNode, Trees

_ONE_AT_A_TIME = threading.Lock()
"""DEAP looks in one place for all threads."""


@contextmanager
def _deap_random(rng: np.random.Generator) -> Iterator[None]:
    own = random.Random(int(rng.integers(2**63)))
    with _ONE_AT_A_TIME:
        of_all, gp.random = gp.random, own
        try:
            yield
        finally:
            gp.random = of_all


@dataclass(frozen=True)
class TreeBreeding:
    """Creation and variation of trees.

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
        """Operators and leaves as deap has them. Raises InputError for more leaves than a byte can name."""
        layout = self.layout
        primitives = gp.PrimitiveSet("program", 0)
        for operator in layout.operators:
            primitives._add(OperatorNode(operator.name, operator.arity, operator.code))
            primitives.prims_count += 1
        names = [*layout.inputs, *map(repr, layout.constants)]
        if len(names) > OWN_BYTE - OPERATOR_CODES:
            raise InputError(f"inputs: {len(names)} elements, a tree can address {OWN_BYTE - OPERATOR_CODES}")
        for row, name in enumerate(names):
            primitives._add(ElementNode(name, OPERATOR_CODES + row))
            primitives.terms_count += 1
        for _ in range(layout.own_constants):
            primitives._add(ConstantNode)
            primitives.terms_count += 1
        return primitives

    @cached_property
    def toolbox(self) -> base.Toolbox:
        """The variation operators as deap has them."""
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
        self, parents: Population, mothers: NDArray[np.intp], fathers: NDArray[np.intp], rng: np.random.Generator
    ) -> Trees:
        """One child a pair of parents, by crossover or one of the mutations."""
        assert isinstance(parents, Trees), "trees are bred from trees"
        children = []
        with _deap_random(rng):
            for mother, father in zip(mothers.tolist(), fathers.tolist(), strict=True):
                children.append(self._child(parents.individuals[mother], parents.individuals[father]))
        return Trees(tuple(children))

    def _child(self, mother: Individual, father: Individual) -> Individual:
        place = gp.random.randrange(len(mother.trees))
        own = gp.PrimitiveTree(mother.trees[place])
        other = father.trees[gp.random.randrange(len(father.trees))]
        toolbox = self.toolbox
        if gp.random.random() < self.crossover:
            child = toolbox.mate(own, gp.PrimitiveTree(other))[0]
        elif self.style == "thesis":
            child = (
                toolbox.mutate_structure(own, other)[0] if gp.random.random() < 0.5 else toolbox.mutate_operator(own)[0]
            )
        elif gp.random.random() < 0.5:
            child = toolbox.mutate_structure(own)[0]
        else:
            child = toolbox.mutate_operator(own)[0]
        if len(child) > self.depth + 1 and child.height > self.depth:
            return mother
        return mother.replaced(place, child)


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
            node = gp.random.choice(primitives.terminals[object])
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
    point = gp.random.randrange(len(mother))
    return (_complete(mother[: point + 1], iter(father[point + 1 :]), primitives),)


def structure_mutation(
    mother: gp.PrimitiveTree, father: gp.PrimitiveTree, primitives: gp.PrimitiveSet
) -> tuple[gp.PrimitiveTree]:
    """Breeding with a crossover point of its own in the father, so that sequences are reused elsewhere."""
    point = gp.random.randrange(len(mother))
    other = gp.random.randrange(len(father))
    return (_complete(mother[: point + 1], iter(father[other:]), primitives),)
