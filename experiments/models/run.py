"""Compare standard model, base compliance, joint bending and `discover` (Fig 5.11).

From the root of the repository: python -m experiments.models.run [--seeds 20] [--runs 4] [--first 0] [--out FOLDER]
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.chapter5 import HAND_MADE, effects_of, options, rounded, save
from experiments.irb6400r_truth import Case, measured_robot
from gpmodel.calibration.comparison import fit_steps, nested_models
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.evolution.linear import Linear
from gpmodel.families import catalogue

STEPS = ("standard", "+ base compliance", "+ joint bending", "the loop's own")
COLUMNS = ("train mean", "train max", "held-out mean", "held-out max")
PLANTED = {
    "the base": {"base compliance", "joint bending, J1"},
    "J5": {"joint compliance, J5"},
    "J4": {"joint compliance, J4"},
    "the eccentricities": {"eccentricity, 1 per turn, several joints"},
}
"""Planted effects by their catalogue names. J1 turns about the vertical, so that a tilt proportional to the moment
is equal below it and above.
"""


def one_robot(seed: int, runs: int, case: Case | None = None) -> dict[str, Any]:
    """The errors of every step on a robot, number `seed` where no other is given, and what the loop finds."""
    case = case or measured_robot(seed)
    named = [(n, catalogue.build(text, case.mechanism, case.poses.states)) for n, text in HAND_MADE]
    rungs = fit_steps(
        case.mechanism,
        nested_models(effects_of(case), named),
        case.poses.subset(case.train),
        case.poses.subset(case.heldout),
    )[1:]
    search = Search(runs=runs, workers=1, strategies=(Linear(),))
    found = discover(case.mechanism, case.poses, case.train, case.heldout, search=search, seed=seed)
    sides = [(s.train_error, s.heldout_error) for s in (*rungs, found.steps[-1])]
    table = [[value for errors in side for value in (errors.mean(), errors.max())] for side in sides]
    return {
        "seed": seed,
        "stiffness": {k: round(v) for k, v in case.stiffness.items()},
        "mm": dict(zip(STEPS, rounded(np.array(table)), strict=True)),
        "found": [{"round": f.round, "name": f.candidate.name, "by": f.candidate.found_by} for f in found.findings],
        "stopped": found.stopped,
    }


def conclusions(robots: list[dict[str, Any]]) -> dict[str, str]:
    """State the number of robots for each conclusion of the thesis, and medians."""
    table = np.array([[r["mm"][step] for step in STEPS] for r in robots])
    base, both = table[:, 1] / table[:, 0], table[:, 2] / table[:, 0]
    loop = table[:, 3] / table[:, 2]
    held = {
        "base compliance: held-out mean at least 20 % less": base[:, 2] <= 0.8,
        "base compliance: held-out maximum at least 20 % less": base[:, 3] <= 0.8,
        "base compliance: training mean at least 20 % less": base[:, 0] <= 0.8,
        "base compliance: training maximum at least 20 % less": base[:, 1] <= 0.8,
        "both: held-out maximum at least 50 % less": both[:, 3] <= 0.5,
        "both: training maximum at least 50 % less": both[:, 1] <= 0.5,
        "the loop: held-out mean no worse than the hand-made model": loop[:, 2] <= 1.0,
        "the loop: held-out maximum no worse than the hand-made model": loop[:, 3] <= 1.0,
        "the loop: held-out mean at least 50 % less than standard": table[:, 3, 2] <= 0.5 * table[:, 0, 2],
    }
    named = [{finding["name"] for finding in r["found"]} for r in robots]
    held |= {f"the loop names {what}": np.array([bool(n & names) for n in named]) for what, names in PLANTED.items()}
    held["the loop names nothing else"] = np.array([n <= set.union(*PLANTED.values()) for n in named])
    return {name: f"{int(yes.sum())} of {len(robots)}" for name, yes in held.items()}


def draw(robots: list[dict[str, Any]]) -> dict[str, Figure]:
    first = np.array([robots[0]["mm"][step] for step in STEPS])
    bars = Figure(figsize=(8, 4), layout="constrained")
    for axes, at in zip(bars.subplots(1, 2, sharey=True), ((0, 1), (2, 3)), strict=True):
        for shift, column, shade in zip((-0.2, 0.2), at, ("tab:blue", "tab:orange"), strict=True):
            shown = axes.bar(np.arange(4) + shift, first[:, column], 0.4, color=shade, label=COLUMNS[column])
            axes.bar_label(shown, fmt="%.2f", fontsize=8)
        axes.set_xticks(range(4), [s.replace(" ", "\n", 2) for s in STEPS], fontsize=8)
        axes.legend(fontsize=8, frameon=False)
    bars.supylabel("3-D error, mm", fontsize=9)
    bars.suptitle(f"Robot {robots[0]['seed']}: 40 training poses (left), 50 held out (right)", fontsize=10)
    many = Figure(figsize=(8, 4), layout="constrained")
    table = np.array([[r["mm"][step] for step in STEPS] for r in robots])
    for axes, column in zip(many.subplots(1, 2), (2, 3), strict=True):
        axes.plot(range(4), table[:, :, column].T, color="0.75", linewidth=0.8)
        axes.plot(range(4), np.median(table[:, :, column], axis=0), "o-", color="tab:red", label="median")
        axes.set_xticks(range(4), [s.replace(" ", "\n", 2) for s in STEPS], fontsize=8)
        axes.set_ylim(0)
        axes.set_title(f"{COLUMNS[column]}, mm: {len(robots)} robots", fontsize=10)
        axes.legend(fontsize=8, frameon=False)
    return {"models": bars, "robots": many}


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = options(__doc__, "models", arguments, seeds=20, runs=4, first=0)
    robots: list[dict[str, Any]] = []
    results: dict[str, Any] = {}
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        robots.append(one_robot(seed, chosen.runs))
        print(robots[-1], flush=True)
        medians = rounded(np.median([[r["mm"][s] for s in STEPS] for r in robots], axis=0), 1.0)
        results = {"columns": COLUMNS, "conclusions": conclusions(robots)}
        results["median_mm"] = dict(zip(STEPS, medians, strict=True))
        save(chosen, {**results, "robots": robots}, draw(robots), seeds=len(robots))
    return {**results, "robots": robots}


if __name__ == "__main__":
    main()
