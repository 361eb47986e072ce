"""Test initial trees, both styles of breeding, and that DEAP's global random state is unchanged."""

import random

import numpy as np
import pytest
from deap import gp

from gpmodel.errors import InputError
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.representation import program_of
from gpmodel.evolution.tree_breeding import TreeBreeding, depth_first_crossover, structure_mutation
from gpmodel.evolution.tree_population import OWN_BYTE, OWN_CONSTANT, Individual, Trees
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
    breeding = TreeBreeding(LAYOUT, depth, style, 0.6)
    trees = breeding.initial(60, rng)
    assert {tree.height for i in trees.individuals for tree in i.trees} == set(range(1, min(depth, 4) + 1))
    for _ in range(8):
        mothers, fathers = rng.integers(0, 60, (2, 60))
        trees = breeding.offspring(trees, mothers, fathers, rng)
    assert all(whole(tree) and tree.height <= depth for i in trees.individuals for tree in i.trees)
    assert len(set(texts(trees))) > 10


@pytest.mark.parametrize("cross", [depth_first_crossover, structure_mutation])
def test_thesis_crossover_keeps_the_mother_up_to_the_point(cross) -> None:
    breeding = TreeBreeding(LAYOUT, 5, "thesis", 0.6)
    trees = [i.trees[0] for i in breeding.initial(60, np.random.default_rng(2)).individuals]
    random.seed(3)
    changed = 0
    for mother, father in zip(trees[:30], trees[30:], strict=True):
        (child,) = cross(mother, father, breeding.primitives)
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
    breeding = TreeBreeding(LAYOUT, 5, "koza", 0.6)
    populations = []
    for _ in range(2):
        rng = np.random.default_rng(8)
        start = breeding.initial(40, rng)
        children = breeding.offspring(start, np.arange(40), np.arange(40)[::-1].copy(), rng)
        populations.append(texts(children))
    assert populations[0] == populations[1]
    assert random.getstate() == before


def test_codes_carry_each_constant_of_its_own() -> None:
    trees = TreeBreeding(LAYOUT, 5, "koza", 0.6).initial(80, np.random.default_rng(9))
    forest = trees.forest
    for p, individual in enumerate(trees.individuals):
        codes = forest.codes[forest.bounds[p, 0] : forest.bounds[p, -1]]
        own = codes[codes >= OWN_CONSTANT] - OWN_CONSTANT
        np.testing.assert_array_equal(own, np.arange(len(individual.constants)))
        np.testing.assert_array_equal(forest.constants[p, : len(own)], individual.constants)


def test_codes_are_those_of_the_nodes_whoever_packed_them_before() -> None:
    rng = np.random.default_rng(9)
    breeding = TreeBreeding(LAYOUT, 5, "koza", 0.6)
    trees = breeding.initial(40, rng)
    children = breeding.offspring(trees, *rng.integers(0, 40, (2, 40)), rng)
    mixed = children.join(breeding.initial(10, rng))
    fresh = type(trees)(tuple(Individual.of(one.trees) for one in mixed.individuals))
    np.testing.assert_array_equal(mixed.forest.codes, fresh.forest.codes)
    np.testing.assert_array_equal(mixed.forest.bounds, fresh.forest.bounds)
    for p, one in enumerate(fresh.individuals):
        codes = fresh.forest.codes[fresh.forest.bounds[p, 0] : fresh.forest.bounds[p, -1]]
        nodes = [node.code for tree in one.trees for node in tree]
        np.testing.assert_array_equal(np.minimum(codes, OWN_BYTE), nodes)


def test_more_leaves_than_a_tree_can_address_are_one_clear_line() -> None:
    layout = Layout(tuple(f"x{k}" for k in range(230)), operator_set("thesis"), (), (None,), 1)
    with pytest.raises(InputError, match="230 elements"):
        TreeBreeding(layout, 5, "koza", 0.6).initial(4, np.random.default_rng(0))
