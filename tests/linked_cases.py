"""Three positive columns, responses of laws in them, and a first generation of programs under a link."""

from collections.abc import Iterator

import numpy as np

from gpmodel.evolution.generations import Generations
from gpmodel.evolution.island import BUDGET
from gpmodel.evolution.linked_problem import LinkedProblem
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.regression import SEQUENCES
from gpmodel.evolution.scoring import Scores
from gpmodel.evolution.settings import Settings
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Program

RNG = np.random.default_rng(3)
COLUMNS = {name: RNG.uniform(1.0, 3.0, 80) for name in "abc"}
INPUTS = Inputs(tuple(COLUMNS), np.array(list(COLUMNS.values())))


def values_of(text: str) -> np.ndarray:
    return parse(text).evaluate(COLUMNS)[0]


def every_other(problem: LinkedProblem) -> Iterator[tuple[int, Program, Scores]]:
    """Every other row of a first population, its program, and the scores of all."""
    run = Generations(problem, Settings(SEQUENCES, budget=BUDGET), np.random.default_rng(0))
    population, scores = run.start()
    for row in range(0, len(population), 2):
        yield row, population.program(row, run.layout), scores
