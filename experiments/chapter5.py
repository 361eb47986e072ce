"""Define the Cartesian problem of Fig 5.2, hand-made models, and paths of results of Chapter 5."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy import stats

from experiments.irb6400r_truth import Case
from gpmodel.application.compensator import cartesian_problem
from gpmodel.arrays import IntArray
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.evolution.problems import CartesianProblem, Inputs
from gpmodel.families import catalogue
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import geometric_effects
from gpmodel.report.origin import versions

POSITION = ("x", "y", "z")
ANGLES = ("J1", "J2", "J3", "J4", "J5", "J6")
KINDS = (*["length"] * 3, *["angle"] * 6)
THESIS_INPUTS = (*POSITION, *ANGLES)
DIGITS = 6
HAND_MADE = (("base compliance", "base_compliance"), ("joint bending", "joint_compliance J5"))


def effects_of(case: Case, names: tuple[str, ...] = ()) -> tuple[Effect, ...]:
    """The standard model (all geometric parameters that 40 poses can tell apart), and catalogue effects by name."""
    added = [e for name in names for e in catalogue.build(name, case.mechanism, case.poses.states)]
    return (*geometric_effects(case.mechanism), *added)


def fit(case: Case, names: tuple[str, ...] = ()) -> Calibration:
    """The standard model with effects of the catalogue, fitted to the training poses."""
    return calibrate(ErrorModel(case.mechanism, effects_of(case, names)), case.poses.subset(case.train))


def cartesian(calibration: Calibration, poses: Poses, norm: str = "max") -> CartesianProblem:
    """Points of the model against measured ones, mm, and joint angles, rad: the thesis' nine inputs, of any kind.

    Rounded to a nanometre, so that the last bits of another machine's linear algebra do not turn evolution elsewhere.
    """
    problem = cartesian_problem(calibration, poses, np.arange(len(poses)), norm)
    values = problem.inputs.select(THESIS_INPUTS).values
    return replace(problem, inputs=Inputs(THESIS_INPUTS, values.round(DIGITS)), measured=problem.measured.round(DIGITS))


def against_chance(real: IntArray, null: IntArray, runs: int) -> dict[str, Any]:
    """Runs that reference each thesis input on real and on shuffled errors, Fisher's one-sided p times the inputs."""
    tables = [[[r, runs - r], [n, runs - n]] for r, n in zip(real, null, strict=True)]
    p = [min(1.0, len(real) * float(stats.fisher_exact(t, "greater").pvalue)) for t in tables]
    outside = [name for name, value in zip(THESIS_INPUTS, p, strict=True) if value < 0.05]
    return {"real": real, "shuffled": null, "p": np.round(p, 5), "outside": outside}


def options(
    text: str | None, folder: str, arguments: list[str] | None, script: str = "run", **defaults: int
) -> argparse.Namespace:
    """Whole-number options with defaults, and --out; `sizes` are their names, `prog` the command without them."""
    parser = argparse.ArgumentParser(prog=f"python -m experiments.{folder}.{script}", description=text)
    for name, value in defaults.items():
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / folder)
    chosen = parser.parse_args(arguments)
    chosen.prog, chosen.sizes = parser.prog, tuple(defaults)
    chosen.results = "results.json" if script == "run" else f"{script}.json"
    return chosen


def save(chosen: argparse.Namespace, results: dict[str, Any], figures: dict[str, Figure], **done: int) -> None:
    """results.json, or under the script's own name, and figures/NAME.png, into --out.

    The command in it is the one that gives these results again. done: options as far as the results go, where they are
    saved before the last robot.
    """
    (chosen.out / "figures" if figures else chosen.out).mkdir(parents=True, exist_ok=True)
    sizes = [f"--{name} {done.get(name, getattr(chosen, name))}" for name in chosen.sizes]
    text = json.dumps(
        {"command": " ".join([chosen.prog, *sizes]), "versions": versions(), **results},
        indent=1,
        default=lambda v: np.asarray(v).tolist(),
    )
    (chosen.out / chosen.results).write_text(text + "\n")
    for name, figure in figures.items():
        figure.savefig(chosen.out / "figures" / f"{name}.png", dpi=110)


def rounded(values: ArrayLike, scale: float = 1e3) -> Any:
    """Metres as millimetres with four decimals, for results.json."""
    return np.round(scale * np.asarray(values, dtype=float), 4).tolist()
