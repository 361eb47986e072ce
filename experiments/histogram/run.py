"""Count the inputs of evolved programs, compared with the null distribution (Figs 5.9 and 5.12).

Two searches, each repeated on permuted errors: the Cartesian search of the thesis, and programs at the slots of the
chain (all sites at once, coefficients by projection). Both have the inputs of the thesis: x, y, z, J1 to J6.
From the root of the repository: python -m experiments.histogram.run [--seeds 20] [--cartesian 3] [--runs 16] (and -h)
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.chapter5 import KINDS, THESIS_INPUTS, against_chance, cartesian, fit, options, save
from experiments.irb6400r_truth import Case, measured_robot
from gpmodel.calibration.result import Calibration
from gpmodel.discovery.targets import targets
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, Problem, SlotProblem
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings, thesis_settings
from gpmodel.model.sites import sites_of

BOTH = ("base_compliance", "joint_compliance J5")
MODELS = {"standard": (), "+ base compliance": BOTH[:1], "+ joint bending": BOTH}
MODELS["+ eccentricity"] = (*BOTH, "eccentricity J1")
Search = tuple[Problem, Settings]
POINTS_AT = {"position or J1 to J3": ("x", "y", "z", "J1", "J2", "J3"), "J5": ("J5",), "J4": ("J4",)}


def cartesian_search(case: Case, model: Calibration, chosen: Namespace) -> Search:
    sequences = replace(Linear.thesis(), crossover=0.03, mutation=0.03)
    settings = thesis_settings(sequences, chosen.population, chosen.generations)
    return cartesian(model, case.poses.subset(case.train)), settings


def slot_search(case: Case, model: Calibration, chosen: Namespace) -> Search:
    train = case.poses.subset(case.train)
    inputs = Inputs(THESIS_INPUTS, np.array([train.states[n] for n in THESIS_INPUTS]), KINDS)
    residual = residual_of(model, train, Criteria(), 0)
    seen = targets(residual, sites_of(case.mechanism), np.arange(len(train)))
    budget = Budget(chosen.slot_population, chosen.slot_generations, seconds=1e9)
    return SlotProblem(inputs, seen, parsimony=2.0), Settings(budget=budget)


SEARCHES = {"Cartesian": cartesian_search, "slot": slot_search}


def count(search: str, case: Case, model: str, chosen: Namespace, rng: np.random.Generator) -> dict[str, Any]:
    """Runs that reference each input, on real and on shuffled errors, and Fisher's one-sided p times the inputs.

    left: the share of its error that the best program of each run leaves: of the largest one, Cartesian, of the squares
    at a slot.
    """
    problem, settings = SEARCHES[search](case, fit(case, MODELS[model]), chosen)
    real, null = np.zeros((2, len(THESIS_INPUTS)), dtype=int)
    left: dict[str, list[float]] = {"real": [], "shuffled": []}
    for gains, counts, shuffle in zip(left.values(), (real, null), (False, True), strict=True):
        for _ in range(chosen.runs):
            best = evolve(problem.shuffled(rng) if shuffle else problem, settings, rng).best
            counts += [name in best.program.inputs for name in THESIS_INPUTS]
            gains.append(round(1.0 - best.gain, 4))
    head = {"search": search, "model": model, "runs": chosen.runs}
    return {**head, **against_chance(real, null, chosen.runs), "left": left}


def pooled(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """All robots' runs together, by search and model, and on how many robots some input of a group stands out."""
    out = []
    for search, model in dict.fromkeys((row["search"], row["model"]) for row in rows):
        those = [row for row in rows if (row["search"], row["model"]) == (search, model)]
        hits = {to: sum(bool({*row["outside"]} & {*names}) for row in those) for to, names in POINTS_AT.items()}
        real, null = (np.sum([row[key] for row in those], axis=0) for key in ("real", "shuffled"))
        runs = sum(row["runs"] for row in those)
        left = {key: round(float(np.median([row["left"][key] for row in those])), 3) for key in ("real", "shuffled")}
        head = {"search": search, "model": model, "runs": runs, "robots": len(those), "robots pointing at": hits}
        out.append({**head, **against_chance(real, null, runs), "median left": left})
    return out


def draw(rows: list[dict[str, Any]]) -> Figure:
    figure = Figure(figsize=(14, 5.5), layout="constrained")
    for axes, row in zip(figure.subplots(2, 4).flat, rows, strict=False):
        for shift, key, shade in ((-0.2, "real", "tab:blue"), (0.2, "shuffled", "0.7")):
            axes.bar(np.arange(len(THESIS_INPUTS)) + shift, row[key], 0.4, color=shade, label=f"{key} errors")
        axes.set_xticks(range(len(THESIS_INPUTS)), [f"{n}*" if n in row["outside"] else n for n in THESIS_INPUTS])
        left = "leaves {real:.0%} of the error, of shuffled errors {shuffled:.0%}".format(**row["median left"])
        axes.set_title(f"{row['search']} search: {row['model']}, {row['runs']} runs\n{left}", fontsize=9)
    figure.axes[0].legend(fontsize=8, frameon=False)
    figure.supylabel("runs that reference the input (* p < 0.05)", fontsize=9)
    return figure


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    sizes = {"population": 65536, "generations": 50, "slot_population": 1024, "slot_generations": 40}
    chosen = options(__doc__, "histogram", arguments, seeds=20, cartesian=3, runs=16, **sizes)
    results: dict[str, Any] = {}
    rows: list[dict[str, Any]] = []
    for seed in range(chosen.seeds):
        case, rng = measured_robot(seed), np.random.default_rng([59, seed])
        for search in SEARCHES if seed < chosen.cartesian else ["slot"]:
            rows += [{"robot": seed, **count(search, case, model, chosen, rng)} for model in MODELS]
        print(seed, [(r["search"], r["model"], r["outside"]) for r in rows if r["robot"] == seed], flush=True)
        results = {"inputs": THESIS_INPUTS, "pooled": pooled(rows), "robots": rows}
        done = {"seeds": seed + 1, "cartesian": min(seed + 1, chosen.cartesian)}
        save(chosen, results, {"histogram": draw(results["pooled"])}, **done)
    return results


if __name__ == "__main__":
    main()
