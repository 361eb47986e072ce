"""Equal trees in DEAP and gplearn: compiled or interpreted as their users run them."""

import random

import numpy as np
from deap import gp

from gpmodel.evolution.tree_breeding import TreeBreeding

NAMES = {"add": np.add, "subtract": np.subtract, "multiply": np.multiply, "max": np.maximum}


def full_trees(breeding: TreeBreeding, count: int, seed: int) -> list[gp.PrimitiveTree]:
    """Full trees of depth 4 over binary operators: 31 nodes."""
    state = random.getstate()
    random.seed(seed)
    trees = [gp.PrimitiveTree(gp.genFull(breeding.primitives, 4, 4)) for _ in range(count)]
    random.setstate(state)
    return trees


def deap_evaluate(trees: list[gp.PrimitiveTree], columns: dict[str, np.ndarray]) -> np.ndarray:
    """``gp.compile`` and a call on arrays, a tree."""
    primitives = gp.PrimitiveSet("main", len(columns))
    primitives.renameArguments(**{f"ARG{k}": name for k, name in enumerate(columns)})
    for name, function in NAMES.items():
        primitives.addPrimitive(function, 2, name=name)
    arguments = list(columns.values())
    return np.array([gp.compile(str(tree), primitives)(*arguments)[0] for tree in trees])


def gplearn_evaluate(trees: list[gp.PrimitiveTree], columns: dict[str, np.ndarray]) -> np.ndarray:
    """gplearn's own interpreter, a tree."""
    from gplearn._program import _Program
    from gplearn.functions import make_function

    functions = {name: make_function(function=f, name=name, arity=2) for name, f in NAMES.items()}
    order = list(columns)
    table = np.column_stack(list(columns.values()))
    settings = {
        "function_set": list(functions.values()), "arities": {2: list(functions.values())},
        "init_depth": (2, 6), "init_method": "half and half", "n_features": len(order), "const_range": None,
        "metric": None, "p_point_replace": 0.1, "parsimony_coefficient": 0.0,
        "random_state": np.random.RandomState(0),
    }  # fmt: skip
    found = []
    for tree in trees:
        nodes = [functions[node.name] if node.arity else order.index(node.name) for node in tree]
        found.append(_Program(program=nodes, **settings).execute(table)[0])
    return np.array(found)
