"""Ten slot-space problems solved by our engines, Operon, gplearn and a DEAP default in the same processor time.

From the root of the repository: python -m experiments.speed.solve [--seconds 3] [--seeds 5] [--eased]
[--engines "linear;Operon"] [--out FOLDER]
Ours look for the place among twenty sites as well as for the shape. The others cannot: they are told the place and
regress what the residual says of the shape there, pose by pose; eased, the true shape itself with the same 10 % of
noise. Solved: 95 % of the gain of the true shape, on held-out poses, with coefficients from the training poses.
"""

import argparse
import json
import os
import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from deap import algorithms, base, creator, gp, tools

from experiments.recovery.engines import available
from experiments.recovery.found import slowdown
from experiments.speed.slot_problems import EFFECTS, NOISE, TRUE_SITE, Planted, planted
from experiments.tables import write_table
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.representation import Representation
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.evolution.tree import Tree

Array = np.ndarray
Predict = Callable[[dict[str, Array]], Array]


def ours(representation: Representation, population: int) -> Callable[[Planted, float, int], tuple[float, bool]]:
    """Held-out gain and whether the place is right."""

    def solve(case: Planted, seconds: float, seed: int) -> tuple[float, bool]:
        budget = Budget(population, seconds=seconds, threads=1, target=0.99 * case.gain)
        best = evolve(case.problem, Settings(representation, budget=budget), np.random.default_rng(seed)).best
        inputs, targets = case.unseen
        held = best.program.evaluate(inputs.mapping())
        return targets.gain_of(held, best.coefficients, best.site), best.site == TRUE_SITE

    return solve


def told_the_place(regress: Callable[..., Any], eased: bool) -> Callable[[Planted, float, int], tuple[float, bool]]:
    """A regression engine on the shape at the true site, scored there."""

    def solve(case: Planted, seconds: float, seed: int) -> tuple[float, bool]:
        problem = case.problem
        inputs, targets = case.unseen
        target = problem.targets.pull[TRUE_SITE] / problem.targets.weight[TRUE_SITE]
        if eased:
            noise = NOISE * case.shape.std() * np.random.default_rng([seed, 1]).normal(size=len(case.shape))
            target = case.shape + noise
        predict: Predict = regress(problem.inputs.mapping(), target, seconds, seed).predict
        train, held = (predict(i.mapping())[None] for i in (problem.inputs, inputs))
        _, coefficients = problem.targets.set_gain(train, TRUE_SITE)
        return targets.gain_of(held, coefficients, TRUE_SITE), True

    return solve


class DeapDefault:
    """DEAP's symbolic regression example: eaSimple, 300 trees, tournament of 3, compile and call."""

    def __init__(self, columns: dict[str, Array], response: Array, seconds: float, seed: int) -> None:
        random.seed(seed)
        primitives = gp.PrimitiveSet("main", len(columns))
        primitives.renameArguments(**{f"ARG{k}": name for k, name in enumerate(columns)})
        for function in (np.add, np.subtract, np.multiply, np.sin, np.cos, np.exp, np.tanh):
            primitives.addPrimitive(function, function.nin)
        primitives.addEphemeralConstant("constant", random.random)
        if not hasattr(creator, "Least"):
            creator.create("Least", base.Fitness, weights=(-1.0,))
            creator.create("Tree", gp.PrimitiveTree, fitness=creator.Least)
        toolbox = base.Toolbox()
        toolbox.register("expr", gp.genHalfAndHalf, pset=primitives, min_=1, max_=2)
        toolbox.register("grown", gp.genFull, min_=0, max_=2)
        toolbox.register("individual", tools.initIterate, creator.Tree, toolbox.expr)
        toolbox.register("select", tools.selTournament, tournsize=3)
        toolbox.register("mate", gp.cxOnePoint)
        toolbox.register("mutate", gp.mutUniform, expr=toolbox.grown, pset=primitives)
        for name in ("mate", "mutate"):
            toolbox.decorate(name, gp.staticLimit(lambda tree: tree.height, 17))
        self.compile = lambda tree: gp.compile(tree, primitives)
        arguments = list(columns.values())

        def fitness(tree: gp.PrimitiveTree) -> tuple[float]:
            with np.errstate(all="ignore"):
                error = float(np.mean(np.square(self.compile(tree)(*arguments) - response)))
            return (error if np.isfinite(error) else 1e300,)

        toolbox.register("evaluate", fitness)
        population = [toolbox.individual() for _ in range(300)]
        self.best = tools.HallOfFame(1)
        begin = time.perf_counter()
        while time.perf_counter() - begin < seconds:
            population, _ = algorithms.eaSimple(population, toolbox, 0.5, 0.1, 1, halloffame=self.best, verbose=False)

    def predict(self, columns: dict[str, Array]) -> Array:
        with np.errstate(all="ignore"):
            return np.broadcast_to(self.compile(self.best[0])(*columns.values()), len(next(iter(columns.values()))))


def write_tables(folder: Path) -> None:
    """Write the tables of both files into the README."""
    for kind in ("solve", "solve_eased"):
        file = folder / f"{kind}.json"
        found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        rows = []
        for engine, row in found.items():
            times = [run["cpu_seconds"] for run in row["runs"] if run["solved"]]
            last = max(times, default=None)
            median = row["median_cpu_seconds_to_solve"]
            solved, load = f"{row['solved']} of {row['of']}", round(row["load"], 1) if "load" in row else None
            rows.append((engine, solved, median and round(median, 2), last, load))
        write_table(folder / "README.md", kind, ("engine", "solved", "median CPU-s", "longest", "load"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--eased", action="store_true")
    parser.add_argument("--engines", default=None)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    chosen = parser.parse_args()
    installed = available(noisy=True)
    peers = {name: told_the_place(installed[name], chosen.eased) for name in ("Operon", "gplearn") if name in installed}
    engines = {
        "linear": ours(Linear(), 1024),
        "tree": ours(Tree(), 512),
        **peers,
        "DEAP default": told_the_place(DeapDefault, chosen.eased),
    }
    file = chosen.out / ("solve_eased.json" if chosen.eased else "solve.json")
    results: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for name in engines if chosen.engines is None else chosen.engines.split(";"):
        solve, rows = engines[name], []
        solve(planted(EFFECTS[0], 99), 1.0, 0)
        for effect in EFFECTS:
            for seed in range(chosen.seeds):
                case = planted(effect, seed)
                begin = time.process_time()
                heldout, placed = solve(case, chosen.seconds * slowdown(), seed)
                solved = bool(placed and heldout >= 0.95 * case.heldout)
                rows.append(
                    {"effect": effect.name, "heldout": round(heldout, 4), "truth": round(case.heldout, 4),
                     "solved": solved, "cpu_seconds": round(time.process_time() - begin, 2)}
                )  # fmt: skip
                print(name, rows[-1], flush=True)
        times = [row["cpu_seconds"] for row in rows if row["solved"]]
        results[name] = {
            "command": f"python -m experiments.speed.solve --seconds {chosen.seconds:g} --seeds {chosen.seeds}"
            f'{" --eased" if chosen.eased else ""} --engines "{name}"',
            "load": os.getloadavg()[0], "solved": len(times), "of": len(rows), "runs": rows,
        }  # fmt: skip
        results[name]["median_cpu_seconds_to_solve"] = float(np.median(times)) if times else None
        chosen.out.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        write_tables(chosen.out)


if __name__ == "__main__":
    main()
