"""Measure evolved compensators at new poses (Fig 5.8), in Cartesian and in slot space.

Both searches have the inputs x, y, z and J1 to J6 at 40 poses of the standard model. A Cartesian program displaces the
tip. A slot program moves the chain at its best slot; each round adds one program and refits all values.
From the root of the repository: python -m experiments.extrapolation.run [--seeds 10] [--population 8192]
[--generations 150] [--slot_population 1024] [--slot_generations 40] [--rounds 4] [--out FOLDER]
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.chapter5 import KINDS, POSITION, THESIS_INPUTS, cartesian, fit, options, rounded, save
from experiments.irb6400r_truth import Case, measured_robot
from gpmodel.application.compensator import MILLIMETRE
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.discovery.targets import targets
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.evidence.score import scores
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings, thesis_settings
from gpmodel.families.candidate import SEQUENCE
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import sites_of
from gpmodel.selection.programs import as_candidate, without_poles

COLUMNS = ("train mean", "train max", "held-out mean", "held-out max")


def in_cartesian_space(case: Case, model: Calibration, chosen: Namespace, rng: np.random.Generator) -> list[Array]:
    """Errors, m, on training and held-out poses of the best compensator of the training poses."""
    seen, unseen = (cartesian(model, case.poses.subset(rows)) for rows in (case.train, case.heldout))
    how = thesis_settings(
        replace(Linear.thesis(), crossover=0.03, mutation=0.03), chosen.population, chosen.generations
    )
    found = evolve(seen, how, rng).best.program
    errors = []
    for problem in (seen, unseen):
        tip = problem.inputs.select(POSITION).values
        compensated = found.evaluate(problem.inputs.mapping()) if found.outputs else tip
        errors.append(np.linalg.norm(compensated - problem.measured, axis=0) / MILLIMETRE)
    return errors


def in_slot_space(case: Case, model: Calibration, chosen: Namespace, rng: np.random.Generator) -> tuple[Any, list[str]]:
    """Errors after each round on training and held-out poses, and the programs with where they act."""
    train, sites, texts = case.poses.subset(case.train), sites_of(case.mechanism), []
    inputs = Inputs(THESIS_INPUTS, np.array([train.states[n] for n in THESIS_INPUTS]), KINDS)
    plain = {name: name for name in THESIS_INPUTS}
    how = Settings(budget=Budget(chosen.slot_population, chosen.slot_generations, seconds=1e9, climb=2))
    for _ in range(chosen.rounds):
        residual = residual_of(model, train, Criteria(), 0)
        problem = SlotProblem(inputs, targets(residual, sites, np.arange(len(train))), parsimony=2.0)
        found = evolve(problem, how, rng)
        offered = [
            as_candidate(f.program, sites[f.site], plain, 2.0 * f.complexity + np.log(len(sites)), SEQUENCE)
            for f in found.front
        ]
        usable = [
            c for c in offered if c is not None and without_poles(Criteria(), c, train.states, train.states.between())
        ]
        best = max(zip(scores(residual, usable), usable, strict=True), key=lambda pair: pair[0].nats)[1]
        texts.append(best.name)
        effects = (*model.model.effects, *best.effects)
        model = calibrate(ErrorModel(case.mechanism, effects), train, condition_limit=model.condition_limit)
    return [model.error, errors_on(model, case.poses.subset(case.heldout))], texts


def one_robot(case: Case, chosen: Namespace, rng: np.random.Generator) -> tuple[dict[str, list[Array]], list[str]]:
    """Errors, m, on training and held-out poses by what compensates, and the programs at the slots."""
    model = fit(case)
    before = [model.error, errors_on(model, case.poses.subset(case.heldout))]
    tip = in_cartesian_space(case, model, chosen, rng)
    slot, texts = in_slot_space(case, model, chosen, rng)
    return {"standard": before, "Cartesian": tip, "slot": slot}, texts


def columns_of(errors: dict[str, list[Array]]) -> dict[str, Any]:
    """COLUMNS of every model, mm."""
    return {k: rounded([v[0].mean(), v[0].max(), v[1].mean(), v[1].max()]) for k, v in errors.items()}


def draw(before: list[Array], tip: list[Array], slot: list[Array]) -> Figure:
    figure = Figure(figsize=(9, 4), layout="constrained")
    titles = ("40 training poses", "50 held-out poses")
    for axes, title, *errors in zip(figure.subplots(1, 2), titles, before, tip, slot, strict=True):
        order = np.argsort(errors[0])
        for error, mark, label in zip(errors, "o^s", ("standard", "Cartesian program", "slot programs"), strict=True):
            axes.semilogy(1e3 * error[order], mark, markersize=4, label=label)
        axes.set(title=title, xlabel="pose, by error of the standard model", ylabel="3-D error, mm")
    figure.axes[0].legend(fontsize=8, frameon=False)
    return figure


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    sizes = {"population": 8192, "generations": 150, "slot_population": 1024, "slot_generations": 40}
    chosen = options(__doc__, "extrapolation", arguments, seeds=10, rounds=4, **sizes)
    robots: list[dict[str, Any]] = []
    pictures: dict[str, Figure] = {}
    results: dict[str, Any] = {}
    for seed in range(chosen.seeds):
        errors, texts = one_robot(measured_robot(seed), chosen, np.random.default_rng([58, seed]))
        robots.append({"robot": seed, "mm": columns_of(errors), "slot programs": texts})
        print(robots[-1], flush=True)
        pictures = pictures or {"extrapolation": draw(*errors.values())}
        results = {"columns": COLUMNS, "robots": robots}
        save(chosen, results, pictures, seeds=seed + 1)
    return results


if __name__ == "__main__":
    main()
