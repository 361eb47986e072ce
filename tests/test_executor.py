"""Test that parallel tasks return equal numbers in the order of the tasks, and that lost workers are replaced."""

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from gpmodel.cluster import scheduled
from gpmodel.errors import InputError
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.representation import Representation
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.evolution.tree import Tree
from gpmodel.executor import Forks, Threads, Workers


def draw(seed: int) -> float:
    """Draw a number that depends only on the task."""
    return float(np.random.default_rng(seed).normal())


def evolve_or_die_once(task: tuple[Path, int]) -> list[str]:
    """Run a small search; return gains to the bit. The first worker that meets run 1 is killed by it."""
    mark, seed = task
    if seed == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), 9)
    return small_run(Linear(), seed)


@cache
def small_run(representation: Representation, seed: int) -> list[str]:
    inputs = Inputs(("a", "b"), np.random.default_rng(0).uniform(-2, 2, (2, 60)))
    problem = SlotProblem(inputs, regression(np.sin(inputs["a"]) * inputs["b"] + inputs["a"] ** 2))
    settings = Settings(representation, budget=Budget(64, 6, seconds=1e9, climb=1))
    return [f"{s.program} {s.gain.hex()}" for s in evolve(problem, settings, np.random.default_rng(seed)).front]


def numbered(workers: Workers, count: int) -> list[float]:
    found = dict(workers(draw, range(count)))
    return [found[n] for n in range(count)]


FORKING = """
import json, os, sys, time
from functools import partial
from pathlib import Path
from gpmodel.errors import InputError
from gpmodel.executor import Forks, called_beside

made = []

def here():
    made.append(os.getpid())
    return list(Forks(2)(abs, [-1, -2]))

def work(number):
    if number == 3 and not Path(sys.argv[1]).exists():
        Path(sys.argv[1]).touch()
        os.kill(os.getpid(), 9)
    inner = [place for place, _ in Forks(2)(abs, range(3))]
    return os.getpid(), number, inner

def fail(number):
    raise InputError("no such thing", "folds")

inner, every = called_beside(Forks(2), here, [partial(work, n) for n in range(8)])
assert made == [os.getpid()] and sorted(inner) == [(0, 1), (1, 2)]
found = dict(enumerate(every))
assert [found[n][1] for n in range(8)] == list(range(8))
assert {tuple(inner) for _, _, inner in found.values()} == {(0, 1, 2)}
assert [own() for _, own in sorted(Forks(2)(lambda number: lambda: number, range(3)))] == [0, 1, 2]
try:
    list(Forks(2)(fail, range(2)))
except InputError as error:
    said = [str(error), error.argument]
try:  # what nobody waits for any more does not go on
    called_beside(Forks(2), partial(fail, 0), [partial(time.sleep, 3600)] * 2)
except InputError as error:
    assert [str(error), error.argument] == said
try:
    list(Forks(2)(lambda _: os.kill(os.getpid(), 9), range(2)))
    raise SystemExit("a task that loses every process passed")
except RuntimeError as error:
    assert "terminated abruptly" in str(error)
print(json.dumps([os.getpid() in {pid for pid, _, _ in found.values()}, said]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="threads stand in elsewhere")
def test_copies_give_every_result_replace_a_lost_one_and_hand_errors_on(tmp_path: Path) -> None:
    """In a process of its own: where other threads run, as here, threads stand in. What is made meanwhile is made there
    and once, though a copy is lost."""
    mark = tmp_path / "mark"
    done = subprocess.run([sys.executable, "-W", "error", "-c", FORKING, mark], capture_output=True, text=True)
    assert not done.returncode, done.stderr
    assert json.loads(done.stdout) == [False, ["folds: no such thing", "folds"]]
    assert mark.exists()


ORPHANS = """
import os, time
from gpmodel.executor import Forks

def sleep(number):
    os.write(1, f"{os.getpid()}\\n".encode())
    time.sleep(60)

list(Forks(2)(sleep, range(2)))
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="threads stand in elsewhere")
def test_copies_end_with_the_process_they_were_made_of() -> None:
    with subprocess.Popen([sys.executable, "-c", ORPHANS], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        copies = [int(parent.stdout.readline()) for _ in range(2)]
        parent.kill()
    until = time.monotonic() + 20.0
    while time.monotonic() < until and any(Path(f"/proc/{pid}").exists() for pid in copies):
        time.sleep(0.1)
    assert not any(Path(f"/proc/{pid}").exists() for pid in copies)


def test_where_other_threads_run_threads_stand_in() -> None:
    with_one_more = threading.Event()
    threading.Thread(target=with_one_more.wait).start()
    try:
        assert {pid for _, pid in Forks(2)(lambda _: os.getpid(), range(4))} == {os.getpid()}
    finally:
        with_one_more.set()


@pytest.mark.long
@pytest.mark.parametrize("workers", [Threads(1), Threads(3), Threads()], ids=repr)
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
    """A reader of ten thousand results holds only a few besides the current one."""

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


@pytest.mark.parametrize(
    ("address", "said"),
    [("local:0", "expected local:N"), ("local:x", "expected local:N"), ("local:", "expected local:N"),
     ("tcp://127.0.0.1:9", "no dask scheduler answers"), ("nonsense://x", "no dask scheduler answers")],
)  # fmt: skip
def test_a_scheduler_that_is_none_is_one_line(address: str, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("gpmodel.cluster.PATIENCE", "200ms")
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
