"""Run the compared engines on a regression problem."""

import time
from dataclasses import replace
from functools import partial
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from experiments.recovery.found import Engine, Found, slowdown
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.regression import regression_front
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.evolution.tree import Tree

Array = NDArray[np.float64]


ALL_NEEDED = "add,sub,mul,div,square,sqrt,sin,cos,tanh,asin,exp,log,constant,variable"
"""Every operator of the laws, and no more."""


def operon(columns: dict[str, Array], response: Array, seconds: float, seed: int, *, criterion: str) -> Found:
    """pyoperon at the settings of its own example, one thread: ten Levenberg-Marquardt steps, error and length.

    Source: Burlacu, Kronberger, Kommenda (2020); pyoperon, example/operon-sklearn.py.
    """
    from pyoperon.sklearn import SymbolicRegressor

    model = SymbolicRegressor(
        allowed_symbols=ALL_NEEDED, optimizer_iterations=10, population_size=1000, pool_size=1000, max_length=50,
        objectives=["r2", "length"], generations=1_000_000, max_evaluations=10**9, epsilon=1e-12, n_threads=1,
        max_time=max(1, round(seconds * slowdown())), model_selection_criterion=criterion, random_state=seed,
    )  # fmt: skip
    model.fit(np.column_stack(list(columns.values())), response)
    return Found(lambda new: np.asarray(model.predict(np.column_stack(list(new.values()))), dtype=float))


SEQUENCES = Linear(operators="physics", own_constants=0, outputs=4, registers=6)
TREES = Tree(operators="physics", own_constants=0, outputs=4)
BUDGET = Budget(restart_after=25, target=1.0 - 1e-10)
PARSIMONY = 3.0


def here(representation: Linear | Tree, population: int) -> Engine:
    """Our search; with one output the program itself is the answer, scaled, as elsewhere."""

    def search(columns: dict[str, Array], response: Array, seconds: float, seed: int) -> Found:
        budget = replace(BUDGET, population=population, seconds=seconds * slowdown())
        settings = Settings(representation, budget=budget)
        inputs = Inputs(tuple(columns), np.array(list(columns.values())))
        problem = SlotProblem(inputs, regression(response), parsimony=PARSIMONY)
        program = evolve(problem, settings, np.random.default_rng(seed)).best.program
        table = np.vstack([program.evaluate(columns), np.ones_like(response)]).T
        solved = np.linalg.lstsq(table, response, rcond=None)[0]

        def predict(new: dict[str, Array]) -> Array:
            return solved[:-1] @ program.evaluate(new) + solved[-1]

        return Found(predict, program, tuple(solved.tolist()))

    return search


def under_links(columns: dict[str, Array], response: Array, seconds: float, seed: int) -> Found:
    """Our regression: a population a link, coefficients solved; seconds are of the processor."""
    inputs = Inputs(tuple(columns), np.array(list(columns.values())))
    laws = regression_front(inputs, response, np.random.default_rng(seed), seconds, clock=time.thread_time)
    law = min(laws, key=lambda law: law.nats)
    return Found(lambda new: law.program.evaluate(new)[0], law.program, (1.0, 0.0))


def gplearn(columns: dict[str, Array], response: Array, seconds: float, seed: int) -> Found:
    """gplearn's SymbolicRegressor, a generation at a time until the time is over."""
    from gplearn.genetic import SymbolicRegressor

    functions = ("add", "sub", "mul", "div", "sqrt", "log", "sin", "cos", "inv")
    table = np.column_stack(list(columns.values()))
    model = SymbolicRegressor(
        population_size=1000, generations=1, function_set=functions, warm_start=True, random_state=seed
    )
    begin = time.thread_time()
    while time.thread_time() - begin < seconds:
        model.fit(table, response)
        model.set_params(generations=model.generations + 1)
        if model._program.raw_fitness_ < 1e-9:
            break
    return Found(lambda new: model.predict(np.column_stack(list(new.values()))))


def available(noisy: bool = False) -> dict[str, Engine]:
    """Our engines, and the peers that are installed; ``noisy`` data let Operon weigh length against error."""
    engines: dict[str, Engine] = {
        "linear, under links": under_links,
        "linear, 4 registers solved": here(SEQUENCES, 1024),
        "linear, 1 register": here(replace(SEQUENCES, outputs=1), 1024),
        "tree, 4 roots solved": here(TREES, 256),
    }
    if find_spec("pyoperon"):
        criterion = "minimum_description_length" if noisy else "mean_squared_error"
        engines["Operon"] = partial(operon, criterion=criterion)
    if find_spec("gplearn"):
        engines["gplearn"] = gplearn
    return engines
