"""Best fitness against generation, linear sequence and binary tree (thesis Fig 5.7).

Fitness is the largest distance, mm, between compensated and measured points over the 40 training poses of robot 0.
From the root of the repository: python -m experiments.fitness.run [--seeds 5] [--generations 100] [--population 65536]
[--tree_population 65536] [--out FOLDER]
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.chapter5 import cartesian, fit, options, rounded, save
from experiments.irb6400r_truth import measured_robot
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.search import evolve
from gpmodel.evolution.selection import Tournament
from gpmodel.evolution.settings import Budget, Settings, thesis_settings
from gpmodel.evolution.tree import Tree
from gpmodel.formula.operators import TABLE_CONSTANTS


def engines(population: int, tree_population: int, generations: int) -> dict[str, Settings]:
    """The thesis' settings at both ends of its 1 to 5 % for crossover and mutation, its trees, and ours."""
    sequences = Linear(
        operators="thesis", constants=TABLE_CONSTANTS, length=160, registers=8, crossover=0.05, mutation=0.03
    )
    budget = Budget(max(population // 4, 40), generations, seconds=1e9, restart_after=0)
    ours = Settings(sequences, Tournament(2), budget)
    mixed = replace(Linear.thesis(), crossover=0.05, mutation=0.05)
    return {
        "linear, thesis, 1 %": thesis_settings(Linear.thesis(), population, generations),
        "linear, thesis, 5 %": thesis_settings(mixed, population, generations),
        "tree, thesis": thesis_settings(Tree.thesis(), tree_population, generations),
        "linear, ours": ours,
        "linear, ours, longer": ours.with_budget(generations=10 * generations),
    }


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = options(__doc__, "fitness", arguments, seeds=5, generations=100, population=65536, tree_population=65536)
    case = measured_robot(0)
    problem = cartesian(fit(case), case.poses.subset(case.train))
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots()
    rows = {}
    for colour, (name, settings) in enumerate(
        engines(chosen.population, chosen.tree_population, chosen.generations).items()
    ):
        runs = [evolve(problem, settings, np.random.default_rng([57, seed])) for seed in range(chosen.seeds)]
        best = np.minimum.accumulate([run.history["best"] for run in runs], axis=1) * 1e3
        generation = 1 + runs[0].history["generation"]
        axes.plot(generation, np.median(best, axis=0), color=f"C{colour}", label=name)
        axes.fill_between(generation, best.min(axis=0), best.max(axis=0), color=f"C{colour}", alpha=0.2, linewidth=0)
        rows[name] = {
            "population": settings.budget.population,
            "evaluations": runs[0].evaluations,
            "final_mm": rounded(best[:, -1], 1.0),
            "median_final_mm": round(float(np.median(best[:, -1])), 4),
            "median_seconds": round(float(np.median([run.seconds for run in runs])), 1),
            "inputs": [run.best.program.inputs for run in runs],
        }
        print(name, rows[name], flush=True)
    start = round(1e3 * problem.initial_norm(), 4)
    axes.axhline(start, color="0.6", linestyle="--", linewidth=1, label="standard model")
    axes.set_xscale("log")
    axes.set(xlabel="generation", ylabel="largest error on 40 training poses, mm", ylim=(0, 1.3 * start))
    axes.legend(fontsize=8, frameon=False)
    results = {"standard_model_mm": start, "engines": rows}
    save(chosen, results, {"fitness": figure})
    return results


if __name__ == "__main__":
    main()
