"""The trimmed and simplified equation of an evolved compensator, and what it adds at each position (thesis Fig 5.10).

Smooth operators only, x, y and z as inputs, root-mean-square fitness and a price on length. Beside it, the base
compliance fitted to the same poses: what the tip moves by it, against position.
From the root of the repository: python -m experiments.compensation.run [--population 8192] [--generations 150]
[--out FOLDER]
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.chapter5 import POSITION, cartesian, fit, options, rounded, save
from experiments.irb6400r_truth import measured_robot
from gpmodel.calibration import errors_on
from gpmodel.evolve import CartesianProblem, Settings, evolve
from gpmodel.mechanism import Array
from gpmodel.model import observe

NANO = 2e-7


def linear_share(move: Array, position: Array) -> float:
    """Share of the variance of a compensation (N,) that a plane over its own horizontal coordinate explains."""
    system = np.column_stack([np.ones(len(position)), position])
    left = move - system @ np.linalg.lstsq(system, move, rcond=None)[0]
    return round(float(1.0 - left.var() / max(move.var(), 1e-30)), 3)


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = options(__doc__, "compensation", arguments, population=8192, generations=150)
    case = measured_robot(0)
    train = case.poses.subset(case.train)
    standard, compliant = fit(case), fit(case, ("base_compliance",))
    full = cartesian(standard, train)
    problem = CartesianProblem(full.inputs.select(POSITION), full.measured, "rms")
    how = Settings.thesis(
        "linear", population=chosen.population, generations=chosen.generations, operators="smooth", parsimony=NANO,
        crossover=0.03, mutation=0.03,
    )  # fmt: skip
    evolved = evolve(problem, how, np.random.default_rng(510))
    program = evolved.best.program.simplify()
    points = problem.inputs.values
    evolved_move = program.evaluate(problem.inputs.mapping()) - points
    without = compliant.theta.copy()
    without[-1] = 0.0
    frame = compliant.placement.registration[""][:3, :3]
    tips = [observe(compliant.model, train, t, compliant.placement).tip[:, :3, 3] for t in (compliant.theta, without)]
    compliant_move = ((tips[0] - tips[1]) @ frame).T
    figure = Figure(figsize=(9, 6.5), layout="constrained")
    shares: dict[str, dict[str, float]] = {"evolved equation": {}, "base compliance": {}}
    for row, (name, move) in zip(
        figure.subplots(2, 2), zip(shares, (evolved_move, compliant_move), strict=True), strict=True
    ):
        for k, axes in enumerate(row):
            shares[name][POSITION[k]] = linear_share(move[k], points[k])
            axes.plot(points[k], 1e3 * move[k], "o", markersize=4)
            axes.set(
                xlabel=f"{POSITION[k]}, m", ylabel=f"Δ{POSITION[k]}, mm",
                title=f"{name}: {100 * shares[name][POSITION[k]]:.0f} % linear",
            )  # fmt: skip
    heldout = case.poses.subset(case.heldout)
    rms = {
        "standard": standard.error,
        "evolved equation": np.linalg.norm(points + evolved_move - full.measured, axis=0),
    }
    results = {
        "stiffness_Nm_per_rad": {"true": case.stiffness["base_compliance"], "fitted": round(1 / compliant.theta[-1])},
        "equation": str(program),
        "as evolved": str(evolved.best.program),
        "latex": program.latex(),
        "train_rms_mm": {k: rounded(np.sqrt(np.mean(v**2))) for k, v in rms.items()},
        "heldout_rms_mm": {
            "standard": rounded(np.sqrt(np.mean(errors_on(standard, heldout) ** 2))),
            "base compliance": rounded(np.sqrt(np.mean(errors_on(compliant, heldout) ** 2))),
        },
        "share linear in own coordinate": shares,
    }
    print(results["equation"], results["latex"], sep="\n")
    save(chosen, results, {"compensation": figure})
    return results


if __name__ == "__main__":
    main()
