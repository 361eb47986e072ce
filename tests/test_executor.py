"""Tasks side by side: every result with its place, the same numbers wherever they ran, and lost workers replaced."""

import os
import sys
import threading
import time
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from gpmodel.errors import InputError
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.representation import Representation
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.evolution.tree import Tree
from gpmodel.executor import Processes, Threads, Workers, scheduled


def draw(seed: int) -> float:
    """What depends on nothing but the task."""
    return float(np.random.default_rng(seed).normal())


def die_once(task: tuple[Path, int]) -> int:
    """The number of the task; the first worker that meets number 3 is killed by it."""
    mark, number = task
    if number == 3 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), 9)
    return number


def evolve_or_die_once(task: tuple[Path, int]) -> list[str]:
    """What a small GP run finds, gains to the bit; the first worker that meets run 1 is killed by it."""
    mark, seed = task
    if seed == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), 9)
    return small_run(Linear(), seed)


@cache
def small_run(representation: Representation, seed: int) -> list[str]:
    inputs = Inputs(("a", "b"), np.random.default_rng(0).uniform(-2, 2, (2, 60)))
    problem = SlotProblem(inputs, regression(np.sin(inputs["a"]) * inputs["b"] + inputs["a"] ** 2))
    settings = Settings(representation, budget=Budget(128, 10, seconds=1e9, climb=1, threads=1))
    return [f"{s.program} {s.gain.hex()}" for s in evolve(problem, settings, np.random.default_rng(seed)).front]


def die(number: int) -> int:
    os.kill(os.getpid(), 9)
    return number


def numbered(workers: Workers, count: int) -> list[float]:
    found = dict(workers(draw, range(count)))
    return [found[n] for n in range(count)]


@pytest.mark.parametrize("workers", [Threads(1), Threads(3), Threads(), Processes(2)], ids=repr)
def test_every_result_comes_with_its_place(workers: Workers) -> None:
    assert numbered(workers, 40) == [draw(n) for n in range(40)]
    assert list(workers(draw, [])) == []


@pytest.mark.parametrize(
    "representation", [pytest.param(Linear(), marks=pytest.mark.long), Tree()], ids=["linear", "tree"]
)
def test_runs_side_by_side_give_what_they_give_one_after_another(representation: Representation) -> None:
    alone = [small_run(representation, seed) for seed in range(3)]
    together = dict(Threads(3)(partial(small_run.__wrapped__, representation), range(3)))
    assert [together[n] for n in range(3)] == alone
    assert len({str(front) for front in alone}) > 1


def test_what_nobody_waits_for_is_not_begun() -> None:
    begun, go_on = [], threading.Event()

    def work(number: int) -> int:
        begun.append(number)
        if number:
            go_on.wait(5.0)
        return number

    found = Threads(2)(work, range(50))
    assert isinstance(found, Iterator)
    before = sys.getswitchinterval()
    assert next(found) == (0, 0)
    go_on.set()
    found.close()  # type: ignore[attr-defined]
    assert sys.getswitchinterval() == before
    assert len(begun) < 10


def test_results_come_as_they_finish() -> None:
    def work(seconds: float) -> float:
        time.sleep(seconds)
        return seconds

    assert next(iter(Threads(2)(work, [0.3, 0.0]))) == (1, 0.0)


def test_no_more_is_held_than_the_workers_can_use() -> None:
    """Of ten thousand results a reader sees, only a few exist beside the one in hand."""

    class Result:
        alive = 0

        def __init__(self) -> None:
            Result.alive += 1

        def __del__(self) -> None:
            Result.alive -= 1

    most = 0
    for _ in Threads(2)(lambda _: Result(), range(10_000)):
        most = max(most, Result.alive)
    assert most < 12


def test_a_lost_process_is_replaced(tmp_path: Path) -> None:
    found = dict(Processes(2)(die_once, [(tmp_path / "mark", n) for n in range(8)]))
    assert found == {n: n for n in range(8)}


def test_a_task_that_loses_every_process_is_an_error() -> None:
    with pytest.raises(RuntimeError, match="terminated abruptly"):
        list(Processes(1)(die, [0]))


@pytest.mark.parametrize(
    ("address", "said"),
    [("local:0", "expected local:N"), ("local:x", "expected local:N"), ("local:", "expected local:N"),
     ("tcp://127.0.0.1:9", "no dask scheduler answers"), ("nonsense://x", "no dask scheduler answers")],
)  # fmt: skip
def test_a_scheduler_that_is_none_is_one_line(address: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("gpmodel.executor.PATIENCE", "200ms")
    with pytest.raises(InputError, match=said) as caught, scheduled(address):
        pass
    assert caught.value.argument == "scheduler"
    assert "\n" not in str(caught.value)


@pytest.mark.long
def test_a_cluster_of_two_processes_one_of_them_killed_gives_the_same(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    with scheduled("local:2") as workers:
        assert numbered(workers, 40) == [draw(n) for n in range(40)]
        found = dict(workers(evolve_or_die_once, [(tmp_path / "mark", n) for n in range(3)]))
    assert (tmp_path / "mark").exists()
    assert [found[n] for n in range(3)] == [small_run(Linear(), n) for n in range(3)]
