"""Evaluate equal trees in DEAP and gplearn."""

import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from deap import gp
from numpy.typing import NDArray

from gpmodel.evolution.machine import Layout
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import Targets
from gpmodel.evolution.tree_breeding import primitives_of

Array = NDArray[np.float64]
KINDS = (*["angle"] * 6, "temperature", "row")
POSES, HELD_OUT, SITES, ENABLED, NOISE, TRUE_SITE = 90, 200, 20, 25, 0.1, 7


@dataclass(frozen=True)
class Effect:
    """A planted effect: its name and its shape over the inputs."""

    name: str
    shape: Callable[[dict[str, Array]], Array]


EFFECTS = (
    Effect("gear harmonic with phase", lambda c: np.sin(2 * c["J4"] + 0.7)),
    Effect("three cycles a turn", lambda c: np.cos(3 * c["J6"] - 1.1)),
    Effect("coupling", lambda c: c["J4"] * np.cos(c["J5"])),
    Effect("local bump", lambda c: np.exp(-(((c["J2"] - 0.6) / 0.4) ** 2))),
    Effect("dead zone", lambda c: np.sign(c["J3"]) * np.maximum(np.abs(c["J3"]) - 0.8, 0)),
    Effect("saturating windup", lambda c: np.tanh(3 * c["J2"])),
    Effect("difference of joints", lambda c: np.sin(c["J3"] - c["J2"])),
    Effect("exponential warm-up", lambda c: np.exp(-5 * c["row"])),
    Effect("hardening spring", lambda c: np.sin(c["J2"]) * np.abs(np.sin(c["J2"]))),
    Effect("warm gravity", lambda c: c["temperature"] * np.sin(c["J2"])),
)


@dataclass(frozen=True)
class Planted:
    """The problem, the true shape on training poses, the truth's gain there and on held-out poses, and these poses."""

    problem: SlotProblem
    shape: Array
    gain: float
    heldout: float
    unseen: tuple[Inputs, Targets]


def planted(effect: Effect, seed: int) -> Planted:
    """Random smooth sensitivities at every site; constants there are the enabled columns."""
    rng = np.random.default_rng(seed)
    poses = POSES + HELD_OUT
    names = (*(f"J{k}" for k in range(1, 7)), "temperature", "row")
    values = np.vstack([rng.uniform(-2.5, 2.5, (6, poses)), rng.uniform(0, 1, (2, poses))])
    columns = dict(zip(names, values, strict=True))
    weights, phases = rng.normal(size=(SITES, 3, 7)), rng.uniform(0, 6, (SITES, 3, 6))
    waves = np.sin(values[None, None, :6] + phases[..., None])
    sensitivity = np.einsum("sck,sckn->snc", weights[..., :6], waves) + weights[:, None, :, 6]
    shape = effect.shape(columns)
    moved = sensitivity[TRUE_SITE] * shape[:, None]
    error = moved / np.sqrt(np.mean(moved**2)) + NOISE * rng.normal(size=moved.shape)
    enabled = sensitivity[rng.permutation(SITES)].transpose(1, 2, 0)
    enabled = np.concatenate([enabled, np.broadcast_to(np.eye(3), (poses, 3, 3))], axis=2)[:, :, :ENABLED]
    train, held = np.arange(POSES), np.arange(POSES, poses)
    parts = [_targets(sensitivity[:, rows], enabled[rows], error[rows]) for rows in (train, held)]
    inputs = [Inputs(names, values[:, rows], KINDS) for rows in (train, held)]
    problem = SlotProblem(inputs[0], parts[0], parsimony=2.0)
    gain, coefficients = parts[0].set_gain(shape[None, train], TRUE_SITE)
    told = parts[1].gain_of(shape[None, held], coefficients, TRUE_SITE)
    return Planted(problem, shape[train], gain, told, (inputs[1], parts[1]))


def _targets(sensitivity: Array, enabled: Array, error: Array) -> Targets:
    columns, _ = np.linalg.qr(enabled.reshape(-1, enabled.shape[2]))
    residual = error.ravel() - columns @ (columns.T @ error.ravel())
    return Targets(
        np.square(sensitivity).sum(axis=2),
        np.einsum("snc,nck->skn", sensitivity, columns.reshape(len(error), 3, -1)),
        np.einsum("snc,nc->sn", sensitivity, residual.reshape(-1, 3)),
        float(residual @ residual),
        tuple(f"site {k}" for k in range(SITES)),
        residual.size,
    )


START = """
import numpy as np
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.evolution.tree import Tree
x = np.random.default_rng(0).normal(size=(3, 40))
problem = SlotProblem(Inputs(("a", "b", "c"), x), regression(x[0] * x[1]))
for kind in (Linear(), Tree()):
    evolve(problem, Settings(kind, budget=Budget(64, 2)), np.random.default_rng(0))
"""


def cold_start() -> dict[str, float]:
    """Seconds of a fresh process that runs both representations once, and of the command's help."""
    found = {}
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
        for name in ("compile cache empty", "compile cache warm"):
            begin = time.perf_counter()
            subprocess.run([sys.executable, "-c", START], check=True, env=environment)
            found[name] = round(time.perf_counter() - begin, 2)
    begin = time.perf_counter()
    shown = [sys.executable, "-c", "from gpmodel.cli.main import main; main()", "evolve", "--help"]
    subprocess.run(shown, check=True, stdout=subprocess.DEVNULL)
    found["gpmodel evolve --help"] = round(time.perf_counter() - begin, 2)
    return found


NAMES = {"add": np.add, "subtract": np.subtract, "multiply": np.multiply, "max": np.maximum}


def full_trees(layout: Layout, count: int, seed: int) -> list[gp.PrimitiveTree]:
    """Full trees of depth 4 over binary operators: 31 nodes."""
    state = random.getstate()
    random.seed(seed)
    trees = [gp.PrimitiveTree(gp.genFull(primitives_of(layout), 4, 4)) for _ in range(count)]
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
