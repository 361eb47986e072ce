"""Measure the speed of genetic programming at the scale of the thesis, compared with other packages.

From the root of the repository: python -m experiments.speed.run [--repeats 9] [--out FOLDER]
gplearn is timed where it is installed. Wall times are medians and bests of one process, one engine after the other;
CPU seconds (all threads) depend less on what else the machine does.
"""

import json
import os
import platform
import resource
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from experiments.options import parsed
from experiments.speed.peers import EFFECTS, cold_start, deap_evaluate, full_trees, gplearn_evaluate, planted
from experiments.tables import write_table
from gpmodel.discovery.search import Search
from gpmodel.evolution import engine
from gpmodel.evolution.generations import Generations
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.machine import Layout
from gpmodel.evolution.problems import CartesianProblem, Inputs
from gpmodel.evolution.representation import label
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Settings, thesis_settings
from gpmodel.evolution.tree import Tree
from gpmodel.evolution.tree_breeding import Trees
from gpmodel.executor import cores
from gpmodel.formula.operators import BY_CODE, operator_set

ARITHMETIC_THEN = 15.9
"""Milliseconds of one core that the arithmetic of an evaluation took on the machine of the goals, as they were set."""


def timed(work: Callable[[], Any], repeats: int) -> dict[str, float]:
    """Milliseconds of ``work`` after one call to warm up."""
    work()
    wall, cpu = [], []
    for _ in range(repeats):
        begin, used = time.perf_counter(), time.process_time()
        work()
        wall.append(1e3 * (time.perf_counter() - begin))
        cpu.append(1e3 * (time.process_time() - used))
    found = {"median_ms": np.median(wall), "best_ms": min(wall), "cpu_ms": np.median(cpu)}
    return {name: round(float(value), 2) for name, value in found.items()}


def thesis_scale(repeats: int) -> dict[str, Any]:
    """65 536 sequences of 160 elements on 40 poses, maximum norm, at the start and after 30 generations."""
    rng = np.random.default_rng(0)
    points, joints = rng.normal(size=(3, 40)), rng.uniform(-1, 1, (6, 40))
    inputs = Inputs(("x", "y", "z", *(f"J{k}" for k in range(1, 7))), np.vstack([points, joints]))
    measured = points + 0.1 * np.stack([np.sin(joints[3]), 0.5 * points[1], np.zeros(40)])
    run = Generations(CartesianProblem(inputs, measured), thesis_settings(Linear.thesis()), rng)
    population, scores = run.start()
    rows = {"evaluation, random population": timed(lambda: run.scored(population), repeats)}
    for _ in range(30):
        population, scores = run.next_generation(population, scores)
    rows["evaluation, generation 30"] = timed(lambda: run.scored(population), repeats)
    rows["one generation"] = timed(lambda: run.next_generation(population, scores), repeats)
    slices = [slice(begin, begin + 2048) for begin in range(0, 65536, 2048)]
    rows["of it: decoding"] = timed(lambda: [population.decoded(run.layout, part).length for part in slices], repeats)
    code = population.decoded(run.layout, slices[0])
    live = np.concatenate([words[:n] & 0xFFFF for words, n in zip(code.words, code.length, strict=True)])
    poses = 32 * sum(np.count_nonzero(live == c) * seconds for c, seconds in operator_seconds().items())
    return {
        "rows": rows,
        "live_instructions_a_program": round(float(code.length.mean()), 1),
        "arithmetic_limit_cpu_ms": round(1e3 * 40 * float(poses), 2),
        "peak_memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
    }


def operator_seconds() -> dict[int, float]:
    """Seconds a pose of each operator, alone, on long rows in the first cache."""
    from gpmodel.evolution.kernels.execute import execute

    rows = np.random.default_rng(0).uniform(0.5, 1.5, (12, 512))
    found = {}
    for code in BY_CODE:
        words = np.array([code | (k << 16) | ((k + 1) << 32) for k in range(4)])
        execute(words, 4, np.empty(0), rows, 8, 512)
        begin = time.thread_time()
        for _ in range(500):
            execute(words, 4, np.empty(0), rows, 8, 512)
        found[code] = (time.thread_time() - begin) / (500 * 4 * 512)
    return found


def trees(poses: int, repeats: int) -> dict[str, Any]:
    """16 384 trees of 31 nodes; peers on 256 of them, scaled."""
    names = tuple("abcdef")
    layout = Layout(names, operator_set("add,subtract,multiply,max"), (), (None,), 1)
    bred = full_trees(layout, 16384, 1)
    columns = dict(zip(names, np.random.default_rng(0).normal(size=(6, poses)), strict=True))
    fixed = layout.fixed_rows(np.stack(list(columns.values())))
    population = Trees(tuple((tree,) for tree in bred))

    first = np.empty(16384)

    def evaluate() -> None:
        for begin in range(0, 16384, 512):
            part = slice(begin, begin + 512)
            first[part] = engine.values(population.decoded(layout, part), fixed)[:, 0, 0]

    rows = {
        "here": timed(evaluate, repeats),
        "here, DEAP trees to codes, all new": timed(lambda: Trees(population.individuals).forest, repeats),
    }
    peers = {"DEAP compile and call": deap_evaluate}
    if find_spec("gplearn"):
        peers["gplearn execute"] = gplearn_evaluate
    for name, peer in peers.items():
        np.testing.assert_allclose(peer(bred[:256], columns), first[:256], rtol=1e-9)
        sample = timed(lambda peer=peer: peer(bred[:256], columns), 3)
        rows[name] = {kind: round(64 * value, 1) for kind, value in sample.items()}
    return rows


def loop_runs(repeats: int) -> dict[str, Any]:
    """One run of each representation with the loop's own budget, on one core, and what it explains of the truth."""
    case = planted(EFFECTS[0], 0)
    rows: dict[str, Any] = {}
    for representation in (Linear(), Tree()):
        settings = Settings(representation, budget=Search().budget(opening=False))
        gains: list[float] = []

        def run(settings: Settings = settings, gains: list[float] = gains) -> None:
            gains.append(evolve(case.problem, settings, np.random.default_rng(len(gains))).best.gain)

        row: dict[str, Any] = timed(run, repeats)
        rows[label(representation)] = row | {"gain": round(max(gains), 4), "true_gain": round(case.gain, 4)}
    return rows


def beside_goals(results: dict[str, Any]) -> dict[str, Any]:
    """Best and median ms of the work that a goal was set for, beside it.

    Also as multiples of the arithmetic of one evaluation, of the same run and of the run of the goals: those of two
    machines, or of a busy and an idle one, compare.
    """
    whole = results["65536 sequences x 160 elements x 40 poses"]
    sequences, arithmetic = whole["rows"], whole["arithmetic_limit_cpu_ms"]
    few, many = (results[f"16384 trees x 31 nodes x {poses} poses"] for poses in (40, 1000))
    measured = {
        "65 536 x 160 x 40, one evaluation": (sequences["evaluation, random population"], 18),
        "one generation of it": (sequences["one generation"], 22),
        "16 384 trees x 31 nodes, DEAP's objects to codes, all new": (few["here, DEAP trees to codes, all new"], 20),
        "the same, evaluation alone": (few["here"], 4),
        "the same, 1000 points": (many["here"], 20),
        "one tree run in the loop": (results["one run in the loop"]["tree"], 700),
    }
    return {
        what: {
            "best_ms": row["best_ms"], "median_ms": row["median_ms"], "goal_ms": goal,
            "median_times_arithmetic": round(row["median_ms"] / arithmetic, 2),
            "goal_times_arithmetic": round(goal / ARITHMETIC_THEN, 2),
        }
        for what, (row, goal) in measured.items()
    }  # fmt: skip


def write_tables(results: dict[str, Any], readme: Path) -> None:
    """Write the measurements into the README."""
    header = ("work", "median ms", "best ms", "goal ms", "median, times the arithmetic", "goal, times the arithmetic")
    order = ("median_ms", "best_ms", "goal_ms", "median_times_arithmetic", "goal_times_arithmetic")
    goals = results["beside goals"].items()
    write_table(readme, "goals", header, [(work, *(row[key] for key in order)) for work, row in goals])
    rows = [
        (f"{what}: {name}", row["median_ms"], row["best_ms"], row["cpu_ms"])
        for what, found in results.items() if isinstance(found, dict)
        for name, row in (found.get("rows", found)).items() if isinstance(row, dict) and "cpu_ms" in row
    ]  # fmt: skip
    sequences = results["65536 sequences x 160 elements x 40 poses"]
    rows.append(("arithmetic of the first line alone, one core", None, None, sequences["arithmetic_limit_cpu_ms"]))
    write_table(readme, "work", ("work", "median ms", "best ms", "CPU ms"), rows)
    cold = results["cold start, s"].items()
    write_table(readme, "start", ("a fresh process", "seconds"), cold)


def main() -> None:
    chosen = parsed(__doc__, repeats=9, out=Path(__file__).parent)
    results = {
        "command": f"python -m experiments.speed.run --repeats {chosen.repeats}",
        "machine": {
            "cores": cores(),
            "processor": platform.processor() or platform.machine(),
            "load": os.getloadavg()[0],
        },
        "65536 sequences x 160 elements x 40 poses": thesis_scale(chosen.repeats),
        "16384 trees x 31 nodes x 40 poses": trees(40, chosen.repeats),
        "16384 trees x 31 nodes x 1000 poses": trees(1000, chosen.repeats),
        "one run in the loop": loop_runs(max(3, chosen.repeats // 6)),
        "cold start, s": cold_start(),
    }
    results["beside goals"] = beside_goals(results)
    chosen.out.mkdir(parents=True, exist_ok=True)
    (chosen.out / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    write_tables(results, chosen.out / "README.md")
    print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
