"""Robots with geometric errors and a second joint that yields and hardens, in their own frame or in a tracker's."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import gpmodel as gp
from gpmodel.arrays import Array
from gpmodel.families.by_name import one_effect_named
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.error_model import ErrorModel, Placement, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
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
