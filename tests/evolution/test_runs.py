"""Test that parallel runs give equal bits at any place, order and number of restarts."""

import pickle
import random
import sys
import threading
from dataclasses import asdict, replace

import numpy as np
import pytest
from executor_cases import Elsewhere

from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import CartesianProblem, Inputs, Problem, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.runs import KeptRuns, Number, Plan, run_all
from gpmodel.evolution.search import Evolution
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.evolution.tree import Tree
from gpmodel.executor import Threads, Workers

INPUTS = Inputs(("x", "y", "z", "J1"), np.random.default_rng(0).uniform(0.5, 2.0, (4, 40)))
BENT = INPUTS.values[:3] + INPUTS["J1"] * INPUTS["y"]
PROBLEMS: dict[str, Problem] = {
    "compensator": CartesianProblem(INPUTS, BENT),
    "slot": SlotProblem(INPUTS, regression(np.sin(2.0 * INPUTS["J1"]) * INPUTS["x"])),
}
BUDGET = Budget(128, 5, seconds=1e9)
PLAN = Plan({"linear": Settings(Linear(), budget=BUDGET), "tree": Settings(Tree(), budget=BUDGET)}, runs=2, seed=3)


class Memory(KeptRuns):
    """Runs kept in memory."""

    def __init__(self) -> None:
        self.runs: dict[Number, Evolution] = {}

    def run(self, number: Number) -> Evolution | None:
        return self.runs.get(number)

    def keep_run(self, number: Number, found: Evolution) -> None:
        assert number not in self.runs
        self.runs[number] = found


def numbers(problem: Problem, workers: Workers, kept: KeptRuns | None = None) -> list[dict[str, object]]:
    """All of every run but how long it took."""
    tasks = PLAN.tasks(problem)
    found = dict(run_all(tasks, workers, kept or KeptRuns(), lambda done: None))
    runs = [PLAN.run(number, found[number], problem, None) for number in tasks]
    timed = ("seconds", "evaluations_per_second")
    histories = [{k: v for k, v in run.history.items() if k not in timed} for run in runs]
    return [asdict(replace(run, seconds=0.0, history=h)) for run, h in zip(runs, histories, strict=True)]


@pytest.mark.long
@pytest.mark.parametrize("kind", PROBLEMS)
def test_no_bit_depends_on_workers_order_or_losses(kind: str) -> None:
    alone = numbers(PROBLEMS[kind], Threads(1))
    assert len(alone) == 8
    assert len({run["program"] for run in alone}) > 4
    assert numbers(PROBLEMS[kind], Threads(3)) == alone
    assert numbers(PROBLEMS[kind], Elsewhere()) == alone


def test_what_is_kept_is_not_done_again() -> None:
    class Stop(Exception):
        pass

    def said(done: int) -> None:
        if done == 3:
            raise Stop

    problem, kept = PROBLEMS["slot"], Memory()
    with pytest.raises(Stop):
        dict(run_all(PLAN.tasks(problem), Threads(1), kept, said))
    assert len(kept.runs) == 3
    counts: list[int] = []
    assert len(dict(run_all(PLAN.tasks(problem), Threads(1), kept, counts.append))) == 8
    assert counts == [3, 4, 5, 6, 7, 8]
    assert numbers(problem, Elsewhere(), kept) == numbers(problem, Threads(2))


def test_what_others_draw_from_pythons_generator_changes_nothing() -> None:
    """A scheduler's threads do, in the process of a worker."""
    tasks = {number: task for number, task in PLAN.tasks(PROBLEMS["slot"]).items() if number[0] == 1}

    def found() -> list[str]:
        own = pickle.loads(pickle.dumps(tasks))
        return [str(run.best.program) for _, run in run_all(own, Threads(1), KeptRuns(), lambda done: None)]

    alone, over = found(), threading.Event()

    def draw() -> None:
        while not over.is_set():
            random.random()

    before, other = sys.getswitchinterval(), threading.Thread(target=draw)
    sys.setswitchinterval(1e-5)
    other.start()
    try:
        assert found() == alone
    finally:
        over.set()
        other.join()
        sys.setswitchinterval(before)


def test_settings_of_names_of_one_length_draw_different_numbers() -> None:
    plan = Plan({name: Settings(Linear(), budget=BUDGET) for name in ("linear", "random")}, runs=2, seed=3)
    drawn = [task.rng.random() for task in plan.tasks(next(iter(PROBLEMS.values()))).values()]
    assert len(set(drawn)) == 8
