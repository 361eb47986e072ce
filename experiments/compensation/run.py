"""Print the simplified equation of an evolved compensator, and its motion at each position (Fig 5.10).

Inputs x, y and z, smooth operators, RMS fitness and a price on length; on registration alone, on the standard model,
and on a model with all found effects but the base compliance. The motion of the tip by the fitted base compliance is
printed for comparison.
From the root of the repository: python -m experiments.compensation.run [--seeds 5] (and -h)
"""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.chapter5 import POSITION, cartesian, effects_of, fit, options, rounded, save
from experiments.irb6400r_truth import measured_robot
from gpmodel.application.compensator import MILLIMETRE
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import CartesianProblem
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import thesis_settings
from gpmodel.formula.algebra import simplify
from gpmodel.formula.printing import latex
from gpmodel.formula.program import Program
from gpmodel.model.error_model import ErrorModel, Poses, observe

PRICE = 1e-5
FOUND = ("joint_compliance J5", "joint_compliance J4", "eccentricity J1", "base_compliance")


def linear_share(move: Array, coordinate: Array) -> float | None:
    """Share of the variance of a compensation (N,) that a line over a coordinate explains; None where constant."""
    left = move - np.polyval(np.polyfit(coordinate, move, 1), coordinate)
    return round(float(1.0 - left.var() / move.var()), 3) if move.std() > 1e-9 else None


def in_metres(model: Calibration, train: Poses) -> CartesianProblem:
    """The problem with points in metres: sin and atan of millimetres are no smooth functions of a place."""
    mm = cartesian(model, train)
    points = mm.inputs.select(POSITION)
    return replace(mm, inputs=replace(points, values=points.values / MILLIMETRE), measured=mm.measured / MILLIMETRE)


def evolved(model: Calibration, train: Poses, chosen: Namespace) -> tuple[Program, Array, Array]:
    """The best equation of all seeds, simplified; the points (3, N) and what it adds to them, m."""
    problem = replace(in_metres(model, train), norm="rms", parsimony=PRICE)
    sequences = replace(Linear.thesis(), operators="smooth", crossover=0.03, mutation=0.03)
    settings = thesis_settings(sequences, chosen.population, chosen.generations)
    runs = [evolve(problem, settings, np.random.default_rng([510, seed])) for seed in range(chosen.seeds)]
    program = min(runs, key=lambda run: run.history["best"].min()).best.program
    return simplify(program), problem.inputs.values, program.evaluate(problem.inputs.mapping()) - problem.inputs.values


def base_compliance_moves(model: Calibration, without: Calibration, train: Poses) -> Array:
    """Return the displacement (3, N) of the tip by the fitted base compliance, the model's last effect, in the root
    frame, m.
    """
    tips = [observe(m.model, train, m.theta, m.placement).tip[:, :3, 3] for m in (model, without)]
    return ((tips[0] - tips[1]) @ model.placement.registration[""][:3, :3]).T


def rms_mm(error: Array) -> Any:
    return rounded(np.sqrt(np.mean(error**2)))


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = options(__doc__, "compensation", arguments, seeds=5, population=65536, generations=150)
    case = measured_robot(0)
    train, heldout = case.poses.subset(case.train), case.poses.subset(case.heldout)
    bare = ErrorModel(case.mechanism, effects_of(case)[:0])
    compliant = fit(case, FOUND)
    rigid = replace(compliant, theta=np.append(compliant.theta[:-1], 0.0))
    models = {"registration": calibrate(bare, train), "standard model": fit(case), "all but the base": rigid}
    results: dict[str, Any] = {"equations": {}, "share linear in own coordinate": {}}
    moves: dict[str, Array] = {}
    for name, model in models.items():
        program, points, moves[f"equation on {name}"] = evolved(model, train, chosen)
        seen = in_metres(model, train).measured - points - moves[f"equation on {name}"]
        results["equations"][name] = {
            "equation": str(program),
            "latex": latex(program),
            "train_rms_mm": {"before": rms_mm(errors_on(model, train)), "after": rms_mm(np.linalg.norm(seen, axis=0))},
        }
        print(program, latex(program), sep="\n")
    moves["base compliance"] = base_compliance_moves(compliant, rigid, train)
    figure = Figure(figsize=(9, 11), layout="constrained")
    for row, (name, move) in zip(figure.subplots(4, 2), moves.items(), strict=True):
        shares = {c: linear_share(move[k], points[k]) for k, c in enumerate(POSITION[:2])}
        results["share linear in own coordinate"][name] = shares
        for k, axes in enumerate(row):
            c = POSITION[k]
            share = shares[c]
            text = "constant" if share is None else f"a line explains {100 * share:.0f} %"
            axes.plot(points[k], 1e3 * move[k], "o", markersize=4)
            axes.set(xlabel=f"{c}, m", ylabel=f"Δ{c}, mm")
            axes.set_title(f"{name}: {text}", fontsize=9)
    results["stiffness_Nm_per_rad"] = {"true": case.stiffness["base_compliance"], "fitted": 1 / compliant.theta[-1]}
    results["heldout_rms_mm"] = {n: rms_mm(errors_on(m, heldout)) for n, m in (*models.items(), ("all", compliant))}
    save(chosen, results, {"compensation": figure})
    return results


if __name__ == "__main__":
    main()
