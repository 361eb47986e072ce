"""Measure the gain of parallel work, and the cost of distribution, many runs and many poses.

python -m experiments.scale             all of it, on an otherwise idle machine; writes results.json
python -m experiments.scale --only overhead,memory
"""

import hashlib
import resource
import time
from collections.abc import Callable
from importlib.resources import as_file, files

import numpy as np
import psutil

from gpmodel.api.arguments import load_mechanism
from gpmodel.api.discover import discover
from gpmodel.api.simulate import simulate
from gpmodel.api.table import read_table
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.cluster import scheduled
from gpmodel.discovery.explore import RoundContext, explore
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.runs import KeptRuns
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.executor import Forks, Threads, Workers
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects, sites_of
from gpmodel.progress import Reporter

ARM = load_mechanism("irb6400r")
TASKS, TASK_SECONDS = 1000, 0.02
"""Number and duration of tasks: the duration of `small_run`, the shortest task; those of a discovery take from 0.3
s.
"""
BLOCK = bytes(20_000)
"""Hashed without the interpreter in twenty microseconds: by so much a task is longer than it should be."""
RUNS = 1000
POSES = 12_000


def demo_residual() -> Residual:
    """Return the residual of the standard model on the shipped table."""
    with as_file(files("gpmodel") / "data" / "demo.csv") as path:
        poses = prepare(ARM, read_table(path, ARM))
    return residual_of(calibrate(ErrorModel(ARM, geometric_effects(ARM)), poses), poses, Criteria(), 0)


def speedup() -> dict[str, object]:
    """Seconds of the GP runs of one round on one worker and on two, each kind warmed up; every way the same numbers."""
    residual, sites = demo_residual(), sites_of(ARM)
    seconds: dict[str, float] = {}
    results = set()

    def run(name: str, workers: Workers, runs: int = 8) -> None:
        search = Search(runs=runs, executor=workers)
        began = time.perf_counter()
        found = explore(residual, sites, search, np.random.default_rng(0), RoundContext(1, Reporter(), KeptRuns()))
        if runs == 8:
            seconds[name] = time.perf_counter() - began
            results.add((tuple(c.name for c in found.candidates), found.null_nats.tobytes()))

    def both(name: str, workers: Workers) -> None:
        run(name, workers, 1)
        run(name, workers)

    for name, workers in (("1 thread", Threads(1)), ("2 threads", Threads(2)), ("2 copies", Forks(2))):
        both(name, workers)
    with scheduled("local:2") as two, scheduled("local:1") as one:
        both("1 dask", one)
        both("2 dask", two)
    return {
        "seconds": seconds, "gain_threads": seconds["1 thread"] / seconds["2 threads"],
        "gain_copies": seconds["1 thread"] / seconds["2 copies"],
        "gain_dask": seconds["1 dask"] / seconds["2 dask"], "same_numbers": len(results) == 1,
    }  # fmt: skip


def busy(seed: int) -> int:
    """Works for as long as a small run, whatever the machine does beside it, and lets other threads go on."""
    end = time.thread_time() + TASK_SECONDS
    while time.thread_time() < end:
        hashlib.sha256(BLOCK).digest()
    return seed


def overhead() -> dict[str, object]:
    """Processor time of a thousand tasks through the executor, less that of the same tasks in a loop, as a share."""
    out: dict[str, object] = {}
    for name, workers in (("threads", Threads(2)), ("one", Threads(1))):
        began = time.process_time()
        for seed in range(TASKS):
            busy(seed)
        alone = time.process_time() - began
        began = time.process_time()
        assert len(list(workers(busy, range(TASKS)))) == TASKS
        out[name] = (time.process_time() - began) / alone - 1.0
    return {"tasks": TASKS, "task_s": TASK_SECONDS, "share": out}


def small_run(seed: int) -> float:
    """One small GP run."""
    inputs = Inputs(("a", "b"), np.random.default_rng(0).uniform(-2, 2, (2, 100)))
    problem = SlotProblem(inputs, regression(np.sin(inputs["a"]) * inputs["b"]))
    settings = Settings(Linear(), budget=Budget(128, 10, seconds=1e9, climb=0))
    return evolve(problem, settings, np.random.default_rng(seed)).best.gain


def memory() -> dict[str, object]:
    """Resident memory, MB, after so many runs two at a time."""
    process, seen = psutil.Process(), {}
    for number, _ in enumerate(Threads(2)(small_run, range(RUNS)), 1):
        if number in (100, 200, 500, RUNS):
            seen[str(number)] = process.memory_info().rss / 2**20
    return {"resident_mb_after": seen, "growth_100_to_1000": seen[str(RUNS)] / seen["100"] - 1.0}


def many_poses() -> dict[str, object]:
    """A whole discovery on twelve thousand poses with a gear error: time, peak memory, what was found."""
    table = simulate(ARM, poses=POSES, effects=["gear_harmonic J4=60 arcsec"], noise="0.03mm", seed=0).table
    began = time.perf_counter()
    found = discover(ARM, table, search=Search(runs=4, workers=2), noise="0.03 mm")
    return {
        "poses": POSES, "seconds": time.perf_counter() - began, "findings": [f.name for f in found.findings],
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }  # fmt: skip


MEASURED: dict[str, Callable[[], dict[str, object]]] = {
    "speedup": speedup, "overhead": overhead, "memory": memory, "many_poses": many_poses,
}  # fmt: skip
