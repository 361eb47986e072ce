"""The six steps of thesis section 5.2.4 in one file to read and change.

From the root of the repository: python -m experiments.framework.run [--rounds 4] [--runs 8] [--population 512]
[--generations 30] [--out FOLDER]
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.chapter5 import KINDS, THESIS_INPUTS, effects_of, options, rounded, save
from experiments.irb6400r_truth import measured_robot
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.discovery.criteria import Criteria
from gpmodel.discovery.residual import residual_of
from gpmodel.discovery.score import scores
from gpmodel.discovery.targets import targets
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.families import catalogue
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import sites_of


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = options(__doc__, "framework", arguments, rounds=4, runs=8, population=512, generations=30)
    case, rng = measured_robot(0), np.random.default_rng(524)
    train, heldout = case.poses.subset(case.train), case.poses.subset(case.heldout)
    model = calibrate(ErrorModel(case.mechanism, effects_of(case)), train)
    inputs = Inputs(THESIS_INPUTS, np.array([train.states[n] for n in THESIS_INPUTS]), KINDS)
    sites = sites_of(case.mechanism)

    # 1. Operators: smooth ones, of the same order as what they are given.
    operators = ("add", "subtract", "multiply", "square", "sin", "cos")
    # 2. Representation: few operations on many inputs suit trees, many on few suit a sequence.
    representation = Linear(operators=operators, crossover=0.03, mutation=0.05)
    # 3. Evolutionary parameters.
    settings = Settings(representation, budget=Budget(chosen.population, chosen.generations, seconds=1e9))

    rounds: list[dict[str, Any]] = []
    figure = Figure(figsize=(3 * chosen.rounds, 5), layout="constrained")
    rows = figure.subplots(2, chosen.rounds, squeeze=False)
    for number, (top, bottom) in enumerate(rows.T, 1):
        before = [model.error, errors_on(model, heldout)]
        residual = residual_of(model, train, Criteria(), 0)
        problem = SlotProblem(inputs, targets(residual, sites, np.arange(len(train))), parsimony=2.0)

        # 4. Which inputs do programs use, more often than on shuffled errors?
        real = [evolve(problem, settings, rng).best for _ in range(chosen.runs)]
        null = [evolve(problem.shuffled(rng), settings, rng).best for _ in range(chosen.runs)]
        used, by_chance = ([sum(n in b.program.inputs for b in best) for n in THESIS_INPUTS] for best in (real, null))

        # 5. How do the evolved equations behave, and which known effect behaves like them?
        best = max(real, key=lambda b: b.gain)
        known = [c for c in catalogue.candidates(case.mechanism, train.states) if not c.has_priors]
        saved = scores(residual, known)
        order = sorted(range(len(known)), key=lambda i: -saved[i].nats)[:3]

        # 6. Put the physical model into the simulation and see what it is worth on poses it has not seen.
        chosen_effect = known[order[0]]
        model = calibrate(ErrorModel(case.mechanism, (*model.model.effects, *chosen_effect.effects)), train)
        after = errors_on(model, heldout)
        rounds.append(
            {
                "inputs": dict(zip(THESIS_INPUTS, zip(used, by_chance, strict=True), strict=True)),
                "equation": f"{best.program} at {best.site_name}",
                "hypotheses": {known[i].name: round(saved[i].nats, 1) for i in order},
                "held-out mean, max before": rounded([before[1].mean(), before[1].max()]),
                "held-out mean, max after": rounded([after.mean(), after.max()]),
            }
        )
        print(rounds[-1], flush=True)
        top.bar(np.arange(9) - 0.2, used, 0.4, label="measured errors")
        top.bar(np.arange(9) + 0.2, by_chance, 0.4, color="0.7", label="shuffled errors")
        top.set_xticks(range(9), THESIS_INPUTS, fontsize=8)
        top.set_title(f"round {number}\n{chosen_effect.name}", fontsize=9)
        bottom.hist([1e3 * before[1], 1e3 * after], bins=12, color=["0.7", "tab:green"], label=["before", "after"])
        bottom.set_xlabel("held-out error, mm", fontsize=8)
        top.set_ylim(0, 1.4 * chosen.runs)
        top.legend(fontsize=7, frameon=False)
        bottom.legend(fontsize=7, frameon=False)
    results = {"robot": 0, "rounds": rounds}
    save(chosen, results, {"framework": figure})
    return results


if __name__ == "__main__":
    main()
