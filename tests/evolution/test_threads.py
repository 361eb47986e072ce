"""Whole runs side by side: in order, to the same bits, and stopped with the one who waits for them."""

import sys
import threading

import numpy as np
import pytest

from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.representation import Representation
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.evolution.threads import side_by_side
from gpmodel.evolution.tree import Tree


@pytest.mark.parametrize("representation", [Linear(), Tree()], ids=["linear", "tree"])
def test_runs_side_by_side_give_what_they_give_one_after_another(representation: Representation) -> None:
    inputs = Inputs(("a", "b"), np.random.default_rng(0).uniform(-2, 2, (2, 60)))
    problem = SlotProblem(inputs, regression(np.sin(inputs["a"]) * inputs["b"] + inputs["a"] ** 2))
    settings = Settings(representation, budget=Budget(128, 10, seconds=1e9, climb=1, threads=1))

    def run(seed: int) -> list[str]:
        return [str(s.program) for s in evolve(problem, settings, np.random.default_rng(seed)).front]

    alone = [run(seed) for seed in range(6)]
    assert list(side_by_side(run, range(6), 3)) == alone
    assert len({str(front) for front in alone}) > 1


def test_what_nobody_waits_for_is_not_begun() -> None:
    begun, go_on = [], threading.Event()

    def work(number: int) -> int:
        begun.append(number)
        if number:
            go_on.wait(5.0)
        return number

    found = side_by_side(work, range(50), 2)
    before = sys.getswitchinterval()
    assert next(found) == 0
    go_on.set()
    found.close()
    assert sys.getswitchinterval() == before
    assert len(begun) < 50
