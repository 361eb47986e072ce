"""Test initial trees, both styles of breeding, and that DEAP's global random state is unchanged."""

import random

import numpy as np
import pytest
from deap import gp

from gpmodel.evolution.machine import Layout
from gpmodel.evolution.representation import program_of
from gpmodel.evolution.tree import Tree
from gpmodel.evolution.tree_breeding import (
    OWN_CONSTANT,
    Trees,
    depth_first_crossover,
    primitives_of,
    structure_mutation,
)
from gpmodel.formula.operators import operator_set

LAYOUT = Layout(("a", "b"), operator_set("thesis"), (1.0,), (None, None), 2, 1)


def texts(trees: Trees) -> list[str]:
    return [str(program_of(trees, row, LAYOUT)) for row in range(len(trees))]


def whole(tree: gp.PrimitiveTree) -> bool:
    missing = 1
    for k, node in enumerate(tree):
        missing += node.arity - 1
        if missing == 0:
            return k == len(tree) - 1
    return False


@pytest.mark.parametrize("style", ["koza", "thesis"])
@pytest.mark.parametrize("depth", [3, 12])
def test_children_are_whole_and_no_deeper_than_allowed(style: str, depth: int) -> None:
    rng = np.random.default_rng(1)
    settings = Tree(depth, style=style, crossover=0.6)
    trees = settings.initial(LAYOUT, 60, rng)
    assert {tree.height for i in trees.individuals for tree in i} == set(range(1, min(depth, 4) + 1))
    for _ in range(8):
        mothers, fathers = rng.integers(0, 60, (2, 60))
        trees = settings.offspring(LAYOUT, trees, mothers, fathers, rng)
    assert all(whole(tree) and tree.height <= depth for i in trees.individuals for tree in i)
    assert len(set(texts(trees))) > 10


@pytest.mark.parametrize("cross", [depth_first_crossover, structure_mutation])
def test_thesis_crossover_keeps_the_mother_up_to_the_point(cross) -> None:
    settings = Tree(style="thesis", crossover=0.6)
    trees = [i[0] for i in settings.initial(LAYOUT, 60, np.random.default_rng(2)).individuals]
    random.seed(3)
    changed = 0
    for mother, father in zip(trees[:30], trees[30:], strict=True):
        (child,) = cross(mother, father, primitives_of(LAYOUT))
        assert whole(child)
        assert child[0].code == mother[0].code
        shared = next((k for k in range(min(len(child), len(mother))) if child[k] is not mother[k]), len(mother))
        if cross is depth_first_crossover:
            tail = child[shared : min(len(child), len(father))]
            assert all(node is other for node, other in zip(tail, father[shared:], strict=False))
        changed += list(child) != list(mother)
    assert changed > 10


def test_the_same_generator_gives_the_same_trees_and_pythons_is_left_alone() -> None:
    random.seed(7)
    before = random.getstate()
    settings = Tree(style="koza", crossover=0.6)
    populations = []
    for _ in range(2):
        rng = np.random.default_rng(8)
        start = settings.initial(LAYOUT, 40, rng)
        children = settings.offspring(LAYOUT, start, np.arange(40), np.arange(40)[::-1].copy(), rng)
        populations.append(texts(children))
    assert populations[0] == populations[1]
    assert random.getstate() == before


def test_codes_are_those_of_the_nodes_and_carry_each_constant_of_its_own() -> None:
    rng = np.random.default_rng(9)
    settings = Tree(style="koza", crossover=0.6)
    trees = settings.initial(LAYOUT, 80, rng)
    bred = settings.offspring(LAYOUT, trees, *rng.integers(0, 80, (2, 80)), rng)
    mixed = bred.join(settings.initial(LAYOUT, 10, rng))
    codes, bounds, constants = mixed.forest
    for p, individual in enumerate(mixed.individuals):
        here, nodes = codes[bounds[p, 0] : bounds[p, -1]], [node for tree in individual for node in tree]
        np.testing.assert_array_equal(np.minimum(here, OWN_CONSTANT), [node.code for node in nodes])
        own = here[here >= OWN_CONSTANT] - OWN_CONSTANT
        np.testing.assert_array_equal(own, np.arange(len(own)))
        np.testing.assert_array_equal(constants[p, own], [n.value for n in nodes if n.code == OWN_CONSTANT])


def test_the_leaves_of_a_tree_are_not_limited_to_a_byte() -> None:
    layout = Layout(tuple(f"x{k}" for k in range(230)), operator_set("add,sin"), (), (None,), 1, 8)
    trees = Tree(outputs=1, own_constants=8).initial(layout, 400, np.random.default_rng(0))
    read = {name for row in range(len(trees)) for name in program_of(trees, row, layout).inputs}
    assert read <= set(layout.inputs)
    assert len(read) > 200
