"""Number of machine poses that knowledge of the bad ball from its own rig replaces.

From the root of the repository: python -m experiments.twelve_balls.posteriors [--machines 6] [--out FOLDER]

Hexapods with one ball out of round. With: a fit beside what a rig of 80 poses says of that ball (`--joint`). Without:
what the loop finds by itself, the catalogue alone. The error is that of 200 further poses without noise.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from experiments.spherical_joint.rig import Rig
from experiments.twelve_balls.run import measured
from experiments.twelve_balls.simulator import BALLS, LIFT, LOBES, Fault, table
from gpmodel.application.joint_posterior import of_the_ball
from gpmodel.application.model_file import SavedModel, saved_model
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.families import catalogue
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.report.origin import versions
from joints import spherical_joint

HERE = Path(__file__).parent
COUNTS = (20, 30, 40, 60, 80, 120)
FRESH, RIG_POSES, GOOD = 200, 80, 3e-6
"""Poses of the error and of the rig; m, the error that is asked for: the noise of a reading in space is 3.5 um."""


def of_the_rig(fault: Fault, seed: int) -> SavedModel:
    """The ball measured alone, told of its lobes: roll and pitch of the machine are J1 and J2 of the joint."""
    joint, rng = spherical_joint(), np.random.default_rng([80, seed])
    rig = Rig(joint, reach=(1.2, 1.2, 2.0))
    q = rig.poses(RIG_POSES, rng)
    lift = LIFT * np.cos(LOBES * q[:, fault.axis] + fault.phase)
    lever = np.divide(joint.tooling_ball, np.linalg.norm(joint.tooling_ball))
    poses = prepare(joint, rig.measure(q, rng, None, lambda q, _: {25 + k: v * lift for k, v in enumerate(lever)}))
    name = f"out-of-round ball, {LOBES} lobes over J{fault.axis + 1}, lift along the lever"
    lobes = next(c for c in catalogue.candidates(joint, poses.states) if c.name == name)
    return saved_model(calibrate(ErrorModel(joint, (*geometric_effects(joint), *lobes.effects)), poses), poses)


def rms(fit: Calibration, poses: Poses) -> float:
    """Return the RMS of the spatial errors, m."""
    return float(np.sqrt(np.mean(errors_on(fit, poses) ** 2)))


def one_machine(seed: int) -> dict[str, Any]:
    """Errors, um, by how many poses were measured, and the first number of them that is good enough for all further."""
    noisy, fault = table("hexapod", seed, True, max(COUNTS), poses=FRESH)
    machine, poses = measured("hexapod", noisy)
    truth = measured("hexapod", table("hexapod", seed, True, max(COUNTS), noise=False, poses=FRESH)[0])[1]
    fresh = truth.subset(np.arange(max(COUNTS), max(COUNTS) + FRESH))
    known = (*geometric_effects(machine), *of_the_ball(BALLS[fault.ball], of_the_rig(fault, seed), machine))
    errors: dict[str, list[float]] = {"with": [], "without": []}
    for count in COUNTS:
        seen, rows = poses.subset(np.arange(count)), np.arange(count)
        errors["with"].append(rms(calibrate(ErrorModel(machine, known), seen), fresh))
        found = discover(machine, seen, rows, rows[:0], search=Search(runs=0, workers=1), seed=seed)
        errors["without"].append(rms(found.final, fresh))
    enough = {
        way: next((c for k, c in enumerate(COUNTS) if max(values[k:]) < GOOD), None) for way, values in errors.items()
    }
    um = {way: [round(1e6 * v, 2) for v in values] for way, values in errors.items()}
    return {"seed": seed, "truth": fault.angle, "poses enough": enough, "rms_um": um}


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    parser = argparse.ArgumentParser(prog="python -m experiments.twelve_balls.posteriors", description=__doc__)
    parser.add_argument("--machines", type=int, default=6)
    parser.add_argument("--out", type=Path, default=HERE)
    chosen = parser.parse_args(arguments)
    machines = []
    for seed in range(chosen.machines):
        machines.append(one_machine(seed))
        print(machines[-1], flush=True)
    command = f"{parser.prog} --machines {chosen.machines}"
    results = {"command": command, "versions": versions(), "counts": COUNTS, "machines": machines}
    (chosen.out / "posteriors.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    return results


if __name__ == "__main__":
    main()
