"""Compute the best fitness by generation, for sequences and trees (Fig 5.7).

Fitness is the largest distance, mm, between compensated and measured points over the 40 training poses of robot 0.
Each run is done again on errors shuffled over the poses.
From the root of the repository: python -m experiments.fitness.run [--seeds 5] [--generations 100] [--population 65536]
[--tree_population 65536] [--longer 10] [--out FOLDER]
"""

from __future__ import annotations

import time
from argparse import Namespace
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.chapter5 import cartesian, fit, options, rounded, save
from experiments.irb6400r_truth import measured_robot
from gpmodel.arrays import Array
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.pareto import Solution
from gpmodel.evolution.problems import CartesianProblem
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings, Tournament, thesis_settings
from gpmodel.evolution.tree import Tree
from gpmodel.formula.operators import TABLE_CONSTANTS


def engines(chosen: Namespace) -> dict[str, Settings]:
    """The thesis' settings at both ends of its 1 to 5 % for crossover and mutation, its trees, and ours; and longer."""
    population, generations, longer = chosen.population, chosen.generations, chosen.longer * chosen.generations
    sequences = Linear(
        operators="thesis", constants=TABLE_CONSTANTS, length=160, registers=8, crossover=0.05, mutation=0.03
    )
    budget = Budget(max(population // 4, 40), generations, seconds=1e9, restart_after=0)
    ours = Settings(sequences, Tournament(2), budget)
    mixed = replace(Linear.thesis(), crossover=0.05, mutation=0.05)
    return {
        "linear, thesis, 1 %": thesis_settings(Linear.thesis(), population, generations),
        "linear, thesis, 5 %": thesis_settings(mixed, population, generations),
        "linear, thesis, 5 %, longer": thesis_settings(mixed, population, longer),
        "tree, thesis": thesis_settings(Tree.thesis(), chosen.tree_population, generations),
        "linear, ours": ours,
        "linear, ours, longer": replace(ours, budget=replace(ours.budget, generations=longer)),
    }


def one_run(problem: CartesianProblem, settings: Settings, seed: int) -> tuple[Solution, Array]:
    """The best program of a run, and the best fitness, mm, after every generation."""
    found = evolve(problem, settings, np.random.default_rng([57, seed]))
    return found.best, np.minimum.accumulate(found.history["best"])


def measured(settings: Settings, problem: CartesianProblem, chosen: Namespace) -> tuple[Array, dict[str, Any]]:
    """Best fitness (seeds, generations), mm, and what results.json says of an engine."""
    started = time.perf_counter()
    runs = [one_run(problem, settings, seed) for seed in range(chosen.seeds)]
    seconds = (time.perf_counter() - started) / chosen.seeds
    null = [
        one_run(problem.shuffled(np.random.default_rng([58, seed])), settings, seed)[1][-1]
        for seed in range(chosen.seeds)
    ]
    best = np.array([history for _, history in runs])
    return best, {
        "population": settings.budget.population,
        "evaluations": settings.budget.population * best.shape[1],
        "final_mm": rounded(best[:, -1], 1.0),
        "median_final_mm": round(float(np.median(best[:, -1])), 4),
        "shuffled_final_mm": rounded(null, 1.0),
        "seconds": round(seconds, 1),
        "inputs": [solution.program.inputs for solution, _ in runs],
    }


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    sizes = {"generations": 100, "population": 65536, "tree_population": 65536, "longer": 10}
    chosen = options(__doc__, "fitness", arguments, seeds=5, **sizes)
    case = measured_robot(0)
    problem = cartesian(fit(case), case.poses.subset(case.train))
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots()
    rows = {}
    tried = engines(chosen)
    for colour, (name, settings) in enumerate(tried.items()):
        best, rows[name] = measured(settings, problem, chosen)
        generation = np.arange(1, best.shape[1] + 1)
        axes.plot(generation, np.median(best, axis=0), color=f"C{colour}", label=name)
        axes.fill_between(generation, best.min(axis=0), best.max(axis=0), color=f"C{colour}", alpha=0.2, linewidth=0)
        print(name, rows[name], flush=True)
    start = round(problem.initial_norm, 4)
    axes.axhline(start, color="0.6", linestyle="--", linewidth=1, label="standard model")
    axes.set_xscale("log")
    axes.set(xlabel="generation", ylabel="largest error on 40 training poses, mm", ylim=(0, 1.3 * start))
    axes.legend(fontsize=8, frameon=False)
    results = {"standard_model_mm": start, "engines": rows}
    save(chosen, results, {"fitness": figure})
    return results


if __name__ == "__main__":
    main()
