"""From how many poses on, and with which fitness, does the histogram of a Cartesian compensator say anything?

The thesis' histogram (Figs 5.9, 5.12) of one robot measured at more and more poses, with three fitnesses: the largest
error, the root mean square, and the root mean square on the half of the poses that evolution did not see. Each run is
done again on errors shuffled over the poses; where those are fitted as well, no histogram can point.
From the root of the repository: python -m experiments.cartesian_histogram.run [--robots 3] [--runs 16] (and -h)
"""

from __future__ import annotations

from argparse import Namespace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.chapter5 import POSITION, THESIS_INPUTS, cartesian, effects_of, options, save
from experiments.irb6400r_truth import measured_robot
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.criteria import Criteria
from gpmodel.evolution.input_histogram import RunRecord, histogram
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.pareto import Solution
from gpmodel.evolution.problems import CartesianProblem, Inputs
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings, Tournament
from gpmodel.formula.operators import TABLE_CONSTANTS
from gpmodel.model.error_model import ErrorModel

POSES = (40, 90, 400)
FITNESS = ("max", "rms", "cross-validated")


def at_poses(problem: CartesianProblem, rows: slice) -> CartesianProblem:
    """Return the problem at some of the poses."""
    inputs = Inputs(problem.inputs.names, problem.inputs.values[:, rows])
    return CartesianProblem(inputs, np.ascontiguousarray(problem.measured[:, rows]), problem.norm)


def best_of(problem: CartesianProblem, fitness: str, settings: Settings, rng: np.random.Generator) -> tuple[Any, float]:
    """The best program of a run, and the share of its fitness that it removes.

    Cross-validated: of the programs that one half of the poses finds worth their length, the best on the other half.
    """
    if fitness != "cross-validated":
        best = evolve(problem, settings, rng).best
        return best.program, best.gain
    seen, unseen = at_poses(problem, slice(0, None, 2)), at_poses(problem, slice(1, None, 2))

    def gain(solution: Solution) -> float:
        if not solution.program.outputs:
            return 0.0
        left = unseen.norm_of(solution.program.evaluate(unseen.inputs.mapping()))
        return 1.0 - left / unseen.initial_norm() if np.isfinite(left) else -np.inf

    best = max(evolve(seen, settings, rng).front, key=gain)
    return best.program, gain(best)


def one_robot(seed: int, poses: int, chosen: Namespace) -> list[dict[str, Any]]:
    """For each fitness: the runs that reference an input, what stands out of chance, and the share of error left."""
    case = measured_robot(seed, poses, poses)
    model = calibrate(ErrorModel(case.mechanism, effects_of(case)), case.poses)
    sequences = Linear(
        operators="thesis", constants=TABLE_CONSTANTS, length=160, registers=8, crossover=0.05, mutation=0.03
    )
    budget = Budget(chosen.population, chosen.generations, seconds=1e9, restart_after=0)
    settings = Settings(sequences, Tournament(2), budget)
    out = []
    for fitness in FITNESS:
        problem = cartesian(model, case.poses, "max" if fitness == "max" else "rms")
        rng = np.random.default_rng([512, seed, poses])
        records, left = [], {}
        for side in ("real", "shuffled"):
            runs = [
                best_of(problem if side == "real" else problem.shuffled(rng), fitness, settings, rng)
                for _ in range(chosen.runs)
            ]
            left[side] = np.round([1.0 - gain for _, gain in runs], 4)
            records += [
                RunRecord("linear", side == "shuffled", program, float(-np.log(max(1.0 - gain, 1e-16))))
                for program, gain in runs
            ]
        counted = histogram(records, THESIS_INPUTS, Criteria().input_significance)
        angles = [name for name in counted.significant if name not in POSITION]
        counts = {"real": counted.counts["linear"], "shuffled": counted.shuffled["linear"]}
        out.append({"robot": seed, "poses": poses, "fitness": fitness, "left": left, **counts, "stand out": angles})
        print(out[-1], flush=True)
    return out


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Medians of what is left, on how many robots real errors are fitted better than all shuffled ones, what points."""
    out = []
    for poses, fitness in dict.fromkeys((row["poses"], row["fitness"]) for row in rows):
        those = [row for row in rows if (row["poses"], row["fitness"]) == (poses, fitness)]
        left = {side: round(float(np.median([row["left"][side] for row in those])), 3) for side in ("real", "shuffled")}
        better = sum(bool(np.median(row["left"]["real"]) < np.min(row["left"]["shuffled"])) for row in those)
        pointed = {n: sum(n in row["stand out"] for row in those) for n in THESIS_INPUTS}
        points = {name: count for name, count in pointed.items() if count}
        head = {"poses": poses, "fitness": fitness, "robots": len(those), "median left": left}
        out.append({**head, "robots fitted better than any shuffled": better, "robots where it stands out": points})
    return out


def draw(rows: list[dict[str, Any]]) -> Figure:
    """Share of the error left against the number of poses, real beside shuffled, one panel a fitness."""
    figure = Figure(figsize=(10, 3.8), layout="constrained")
    for axes, fitness in zip(figure.subplots(1, len(FITNESS), sharey=True), FITNESS, strict=True):
        for side, shade, shift in (("real", "tab:blue", 0.96), ("shuffled", "0.6", 1.04)):
            those = [row for row in rows if row["fitness"] == fitness]
            at = np.concatenate([np.full(len(row["left"][side]), shift * row["poses"]) for row in those])
            axes.plot(at, np.concatenate([row["left"][side] for row in those]), "o", color=shade, ms=3, label=side)
        axes.set(title=fitness, xlabel="poses", xscale="log")
        axes.set_xticks(POSES, [str(n) for n in POSES])
        axes.minorticks_off()
    figure.axes[0].set_ylabel("share of the error that the best program leaves")
    figure.axes[0].legend(fontsize=8, frameon=False)
    return figure


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    sizes = {"population": 4096, "generations": 150, "most_poses": 400}
    chosen = options(__doc__, "cartesian_histogram", arguments, robots=3, runs=16, **sizes)
    rows: list[dict[str, Any]] = []
    results: dict[str, Any] = {}
    for poses in (n for n in POSES if n <= chosen.most_poses):
        for seed in range(chosen.robots):
            rows += one_robot(seed, poses, chosen)
        results = {"inputs": THESIS_INPUTS, "summary": summary(rows), "robots": rows}
        save(chosen, results, {"cartesian_histogram": draw(rows)}, most_poses=poses)
    return results


if __name__ == "__main__":
    main()
