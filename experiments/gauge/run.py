"""Compute the error of `predict` with and without instrument errors, at exact positions of new poses.

Every robot has geometric errors, a compliant and hardening second joint, and 0.03 mm of noise. Tables are in the frame
of the robot or of a tracker, with or without a tracker error. With --discovers 0 the true model is fitted to tables
with a tracker error, without a search.
From the root of the repository: python -m experiments.gauge.run [--robots 40] [--poses 120] [--discovers 1]
[--times 1] [--first 0] [--out FOLDER]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

import gpmodel as gp
from experiments.chapter5 import options, rounded, save
from gpmodel.application.model_file import SavedModel, saved_model
from gpmodel.application.predict import placement_columns
from gpmodel.application.usable import usable
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.families.by_name import one_effect_named
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import ErrorModel, Placement, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import rank, se3
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset, unmeasured

ARMS = ("panda", "ur5", "irb6400r")
MOTIONS = {"two joints": 2, "narrow": 0.3, "wide": 2.5}
INSTRUMENTS = ("own frame", "tracker", "range offset", "range scale", "elevation index", "eccentric azimuth")
PLANTED = {
    "range offset": ("range offset of the instrument", 2e-4),
    "range scale": ("range scale of the instrument", 5e-5),
    "elevation index": ("elevation index of the instrument", 1e-4),
    "eccentric azimuth": ("eccentricity of the instrument's azimuth", 1e-4),
}
NOISE, GEOMETRY, YIELDS, HARDENS, FRESH = 3e-5, 2e-4, 3e-3, 1.5e-3, 300


def joint_values(arm: Mechanism, motion: str, count: int, rng: np.random.Generator) -> Array:
    """Draw values of two joints alone, or of all joints within a range about one pose, rad."""
    lower, upper = np.array([(max(j.lower, -2.6), min(j.upper, 2.6)) for j in arm.joints]).T
    middle = rng.uniform(0.7 * lower + 0.3 * upper, 0.3 * lower + 0.7 * upper)
    if motion == "two joints":
        q = np.tile(middle, (count, 1))
        q[:, :2] = rng.uniform(
            (np.radians(-90), max(lower[1], -1.5)), (np.radians(150), min(upper[1], 1.5)), (count, 2)
        )
        return q
    reach = MOTIONS[motion]
    return rng.uniform(np.maximum(lower, middle - reach), np.minimum(upper, middle + reach), (count, len(middle)))


def placed(instrument: str, rng: np.random.Generator) -> Placement:
    """The robot's own frame to a millimetre and a milliradian, or a tracker 5 m away at the height of its base."""
    register = se3.exp(1e-3 * rng.normal(size=6))
    if instrument != "own frame":
        register = se3.exp(np.append(np.zeros(5), rng.uniform(-3, 3))) @ register
        bearing = rng.uniform(-3, 3)
        register[:3, 3] += rng.uniform(4.5, 5.5) * np.array([np.cos(bearing), np.sin(bearing), 0.0])
    return Placement({"": register}, {"": se3.shift(rng.uniform(0.05, 0.15, 3))}, {})


@dataclass(frozen=True)
class Measured:
    """Poses, fresh joint values, where the tool is there (FRESH, 3), m, what would be read, and the true model."""

    poses: Poses
    fresh: Dataset
    exact: Array
    read: Array
    model: ErrorModel


def measured(case: tuple[str, str, str], count: int, seed: int, times: float = 1.0) -> Measured:
    """Measure a robot of some arm, motion and instrument at so many poses. times: factor on the planted error."""
    name, motion, instrument = case
    rng, arm = np.random.default_rng([89, seed]), gp.load_mechanism(name)
    bare = unmeasured([j.name for j in arm.joints], joint_values(arm, motion, count + FRESH, rng))
    poses, joint = prepare(arm, bare), arm.joints[1]
    load = float(np.abs(poses.states[f"torque_{joint.name}"]).max())
    torque, (slot, axis, _) = f"(torque_{joint.name}/{load:.6g})", joint.drive[0]
    laws = {f"{slot}:{axis}:{torque}": YIELDS, f"{slot}:{axis}:sign({torque})*power(abs({torque}), 0.6)": HARDENS}
    effects = [e for text in laws for e in one_effect_named(text, arm, poses.states)]
    geometry = geometric_effects(arm)
    theta = np.append(GEOMETRY * rng.normal(size=len(geometry)), list(laws.values()))
    model, placement = ErrorModel(arm, (*geometry, *effects)), placed(instrument, rng)
    exact = read = observe(model, poses, theta, placement).tip[:, :3, 3]
    if instrument in PLANTED:
        seen = prepare(arm, replace(bare, position=exact))
        own = one_effect_named(PLANTED[instrument][0], arm, seen.states)
        model, theta = (
            replace(model, effects=(*model.effects, *own)),
            np.append(theta, [times * PLANTED[instrument][1]] * len(own)),
        )
        read = observe(model, seen, theta, placement).tip[:, :3, 3]
    table = replace(bare, position=read + NOISE * rng.normal(size=read.shape))
    rows, fresh = np.arange(count), np.arange(count, count + FRESH)
    return Measured(prepare(arm, table.subset(rows)), bare.subset(fresh), exact[fresh], read[fresh], model)


def judged(saved: SavedModel, made: Measured) -> dict[str, Any]:
    """RMS, mm, at fresh poses: of predict, the same registered anew, as measured; of their difference, and what of that
    over the measured poses a rigid motion of registration and tool takes up."""
    plain, read = (usable(saved, as_measured=as_measured) for as_measured in (False, True))
    (here, there), (own, other) = (
        [_points(s, data) for s in (plain, read)] for data in (made.fresh, made.poses.dataset)
    )
    turn, shift = se3.fit_rotation(here, made.exact)
    left = [made.exact - here, made.exact - here @ turn.T - shift, made.read - there, there - here]
    values = rounded([root_mean_square(np.linalg.norm(part, axis=1)) for part in left])
    poses = prepare(saved.mechanism, made.poses.dataset)
    observed = observe(plain.model, poses, plain.theta, plain.placement)
    rigid = rank.orthonormal(placement_columns(plain, poses, observed).reshape(3 * len(poses), -1))
    taken = float(np.linalg.norm(rigid.T @ (other - own).ravel())) / np.sqrt(len(poses))
    columns = ("plain_mm", "registered_mm", "as_measured_mm", "difference_mm", "rigid_mm")
    return dict(zip(columns, [*values, rounded(taken)], strict=True))


def _points(saved: SavedModel, data: Dataset) -> Array:
    poses = prepare(saved.mechanism, data)
    return observe(saved.model, poses, saved.theta, saved.placement).tip[:, :3, 3]


def told(made: Measured) -> SavedModel:
    """The model of the truth fitted to the table: nothing is left to be found."""
    return saved_model(calibrate(made.model, made.poses), made.poses)


def one_robot(case: tuple[str, str, str], count: int, seed: int, discovers: bool, times: float) -> dict[str, Any]:
    """Return the error of `predict` for one robot, from a discovery or from the true model fitted to the table."""
    made = measured(case, count, seed, times)
    if not discovers:
        return {"case": list(case), **judged(told(made), made)}
    table, arm = made.poses.dataset, made.model.mechanism
    found = gp.discover(arm, table, holdout=0.3, search=gp.Search(runs=0), seed=seed)
    own = [f.name for f in found.findings if f.slot == "instrument"]
    return {"case": list(case), **judged(found.model.saved, made), "instrument": own}


def main(arguments: list[str] | None = None) -> None:
    chosen = options(__doc__, "gauge", arguments, robots=40, poses=120, discovers=1, times=1, first=0)
    chosen.results = "results.json" if chosen.discovers else "told.json"
    cases = list(product(ARMS, MOTIONS, INSTRUMENTS if chosen.discovers else PLANTED))
    order, done = np.random.default_rng(89).permutation(len(cases)), list[dict[str, Any]]()
    for k in range(chosen.robots):
        case, seed = cases[order[k % len(cases)]], chosen.first + k
        done.append(one_robot(case, chosen.poses, seed, bool(chosen.discovers), chosen.times))
        bare = [r["plain_mm"] / r["as_measured_mm"] for r in done if r["case"][2] not in PLANTED]
        counts = {"robots": len(done), "not_planted": len(bare), "largest_ratio": max(bare, default=None)}
        save(chosen, {**counts, "each": done}, {}, robots=len(done))


if __name__ == "__main__":
    main()
