"""Creation and variation of trees (Robertson 2003, 5.2.2, Fig 5.6), by the library DEAP.

DEAP uses Python's global random generator, which other threads may use too. Every call in this module replaces the
global generator by one seeded from the given NumPy generator. Kinds of quantities are enforced when a program is
decoded, as for sequences: DEAP's typed sets need one kind of result for every operator and a leaf of every kind, and no
leaf is a squared angle.
"""

import random
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import chain

import numpy as np
from deap import base, gp
from numpy.typing import NDArray

from gpmodel.errors import InputError
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.representation import Population
from gpmodel.evolution.tree_population import (
    OPERATOR_CODES,
    OWN_BYTE,
    ConstantNode,
    ElementNode,
    Individual,
    OperatorNode,
    Trees,
)

SHALLOW, DEEPEST_START = 1, 4
"""Smallest and largest depth of initial trees by ramped half-and-half (Koza 1992: 2 to 6, for larger populations)."""

_ONE_AT_A_TIME = threading.Lock()
"""Lock held while DEAP runs, because all threads share its random generator."""


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
    """Creation and variation of programs that are trees. depth, style, crossover: settings as in ``Tree``."""

    layout: Layout
    depth: int
    style: str
    crossover: float

    @cached_property
    def primitives(self) -> gp.PrimitiveSet:
        """Operators and leaves as DEAP primitives.
        Raises InputError if there are more leaves than one byte can number."""
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
        """Variation operators as a DEAP toolbox."""
        toolbox = base.Toolbox()
        deepest = min(DEEPEST_START, self.depth)
        toolbox.register("start", gp.genHalfAndHalf, pset=self.primitives, min_=SHALLOW, max_=deepest)
        if self.style == "koza":
            toolbox.register("mate", gp.cxOnePoint)
            grown = partial(gp.genFull, min_=0, max_=2)
            toolbox.register("mutate_structure", lambda own, _: gp.mutUniform(own, grown, self.primitives))
        else:
            toolbox.register("mate", depth_first_crossover, primitives=self.primitives)
            toolbox.register("mutate_structure", structure_mutation, primitives=self.primitives)
        toolbox.register("mutate_operator", lambda own, _: gp.mutNodeReplacement(own, self.primitives))
        return toolbox

    def initial(self, population: int, rng: np.random.Generator) -> Trees:
        with _deap_random(rng):
            starts = [[self.toolbox.start() for _ in range(self.layout.outputs)] for _ in range(population)]
        return Trees(tuple(Individual.of(map(gp.PrimitiveTree, trees)) for trees in starts))

    def offspring(
        self, parents: Population, mothers: NDArray[np.intp], fathers: NDArray[np.intp], rng: np.random.Generator
    ) -> Trees:
        assert isinstance(parents, Trees), "trees are bred from trees"
        children = []
        with _deap_random(rng):
            for mother, father in zip(mothers.tolist(), fathers.tolist(), strict=True):
                children.append(self._child(parents.individuals[mother], parents.individuals[father]))
        return Trees(tuple(children))

    def _child(self, mother: Individual, father: Individual) -> Individual:
        place = gp.random.randrange(len(mother.trees))
        own = gp.PrimitiveTree(mother.trees[place])
        other = gp.PrimitiveTree(father.trees[gp.random.randrange(len(father.trees))])
        if gp.random.random() < self.crossover:
            vary = self.toolbox.mate
        else:
            vary = self.toolbox.mutate_structure if gp.random.random() < 0.5 else self.toolbox.mutate_operator
        child = vary(own, other)[0]
        if len(child) > self.depth + 1 and child.height > self.depth:
            return mother
        return mother.replaced(place, child)


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
