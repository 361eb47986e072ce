"""Measure whether a calibration without a length standard makes a robot worse than its description.

README.md describes the robots and the comparison.
From the root of the repository: python -m experiments.touches.run [--robots 40] [--cases CASE ...] [--out FOLDER]
"""

import json
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import gpmodel as gp
from experiments.options import parsed
from gpmodel.api.simulate import SimulationResult
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.calibration.undeclared import apart_from_effects
from gpmodel.errors import InputError
from gpmodel.files import to_json, write_text
from gpmodel.mechanism.branches import branched, random_poses
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import ErrorModel, Placement, observe, prepare
from gpmodel.model.sites import standard_effects
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import frame_of
from gpmodel.report.origin import versions
from gpmodel.table.dataset import unmeasured

HERE, ARM, FOLD_SEED = Path(__file__).parent, gp.load_mechanism("irb6400r"), 1500
EFFECTS = ("joint_compliance J2=1.5e-6", "gear_harmonic J4=200 arcsec", "gear_harmonic J1=60 arcsec")
LIGHT = ("joint_compliance J2=2e-5", "gear_harmonic J4=400 arcsec", "gear_harmonic J1=120 arcsec")
OF_TWO = ("joint_compliance left_2=2e-5", "gear_harmonic right_2=200 arcsec", "gear_harmonic table=60 arcsec")


@dataclass(frozen=True)
class Case:
    """Robots of one kind: mechanism, undeclared effects, instrument, poses and noise."""

    mechanism: Mechanism
    effects: tuple[str, ...]
    instrument: str
    poses: int
    noise: str = "0.05 mm"


CASES = {
    "planes": Case(ARM, EFFECTS, "planes", 100),
    "points": Case(ARM, EFFECTS, "points", 120),
    "bar": Case(ARM, EFFECTS, "bar", 120),
    "camera": Case(ARM, EFFECTS, "camera", 40, "0.1 px"),
    "light arm, planes": Case(gp.load_mechanism("ur10"), LIGHT, "planes", 100),
    "two arms, points": Case(gp.load_mechanism(HERE / "two_arms.toml"), OF_TWO, "points", 160),
}
MODELS = {"standard": ("*",), "joint zeros": ("* Rz",)}


def carried(model: ErrorModel, theta: Array, placement: Placement, q: Array) -> Array:
    """Points (N, 3), m, in the root: of the tool, or of the board in the hand where that is all that was seen; of
    several arms in turn."""
    held, arm = placement.anchors.get("board B"), model.mechanism
    tool = placement.tool if held is None else {"": frame_of(held)}
    placed = replace(placement, registration={"": np.eye(4)}, tool=tool)
    tree, data = branched(arm), unmeasured([j.name for j in arm.joints], q)
    if tree is not None:
        tips = np.resize(np.array(list(tree.tips)), len(q))
        data = replace(data, labels={"tip": tips, "tool": tips})
    return observe(model, prepare(arm, data), theta, placed).tips.root[:, :3, 3]


def judged(made: SimulationResult, fits: list[Calibration]) -> list[tuple[float, float]]:
    """Mean errors, mm, inside and outside the measured region, of several fits."""
    truth, here = made.truth.saved, made.table.q
    where = random_poses(truth.mechanism, FOLD_SEED, np.random.default_rng(5))
    real, seen = (carried(truth.model, truth.theta, truth.placement, q) for q in (where, here))
    middle = np.median(seen, axis=0)
    reach = np.quantile(np.linalg.norm(seen - middle, axis=1), 0.9)
    inside, out = np.linalg.norm(real - middle, axis=1) < reach, []
    for fit in fits:
        turn, shift = se3.fit_rotation(carried(fit.model, fit.theta, fit.placement, here), seen)
        found = carried(fit.model, fit.theta, fit.placement, where) @ turn.T + shift
        error = 1e3 * np.linalg.norm(found - real, axis=1)
        out.append((float(error[inside].mean()), float(error[~inside].mean())))
    return out


def robot(case: Case, seed: int) -> dict[str, dict[str, float]]:
    """Errors of one robot, mm, before and after, by what is calibrated."""
    arm, scene = case.mechanism, {"poses": case.poses, "instrument": case.instrument, "noise": case.noise}
    made = gp.simulate(arm, case.effects, geometry_sigma="0.3 mm", seed=seed, **scene)
    poses = prepare(arm, made.table)
    models = ((), *(standard_effects(arm, patterns) for patterns in MODELS.values()))
    fits = [apart_from_effects(calibrate(ErrorModel(arm, effects), poses), poses) for effects in models]
    before, *after = judged(made, fits)
    return {
        name: {"inside": before[0], "inside after": error[0], "outside": before[1], "outside after": error[1],
               "read": 1e3 * float(fit.error.mean())}
        for name, error, fit in zip(MODELS, after, fits[1:], strict=True)
    }  # fmt: skip


def robots(case: Case, count: int) -> list[dict[str, dict[str, float]]]:
    """The robots that reach what they touch, of so many."""
    found = []
    for seed in range(count):
        with suppress(InputError):
            found.append(robot(case, seed))
    return found


def main(arguments: list[str] | None = None) -> None:
    """Run all robots and write results.json."""
    chosen = parsed(__doc__, arguments, robots=40, cases=",".join(CASES), out=HERE)
    file = chosen.out / "results.json"
    results = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    results |= {"command": f"python -m experiments.touches.run --robots {chosen.robots}", "versions": versions()}
    for case in chosen.cases.split(","):
        made = robots(CASES[case], chosen.robots)
        for name in MODELS:
            each = [errors[name] for errors in made]
            worse = {side: sum(r[f"{side} after"] > r[side] for r in each) for side in ("inside", "outside")}
            mean = {key: float(np.mean([r[key] for r in each])) for key in each[0]}
            results[f"{case}, {name}"] = {"mean": mean, "worse": worse, "robots": each}
            said = ", ".join(f"{key} {value:.3f}" for key, value in mean.items())
            print(f"{case}, {name}: {said}; worse {worse}", flush=True)
            write_text(file, to_json(results))


if __name__ == "__main__":
    main()
