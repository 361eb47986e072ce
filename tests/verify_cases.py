"""A calibrated robot, and later measurements of the robot by an instrument at another place."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from cli_cases import robot

import gpmodel as gp
from gpmodel.arrays import Array
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, Placement, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
from gpmodel.planning.simulate import Simulation
from gpmodel.table.dataset import Dataset, unmeasured

NOISE = 2e-5
Fitted = tuple[gp.Model, Simulation]


@cache
def fitted_robot(geometry_sigma: float = 3e-4) -> Fitted:
    """A robot whose base yields, with its measurement. geometry_sigma: of its constants, rad and m."""
    arm, made = robot(60, seed=3, noise=NOISE, effects=("base_compliance=5e-9",), geometry_sigma=geometry_sigma)
    return gp.calibrate(arm, made.dataset, ["base_compliance"], holdout=0.0).model, made


def placed_anew(made: Simulation, rng: np.random.Generator, tool: float = 0.0) -> Placement:
    """The instrument elsewhere, and a tool that slipped along x, m."""
    frame = made.placement.tool[""].copy()
    frame[0, 3] += tool
    return Placement({"": se3.exp(rng.normal(0.0, 1.0, 6))}, {"": frame}, {})


def read_later(
    made: Simulation, q: Array, placement: Placement, rng: np.random.Generator, joint: int = 0, moved: float = 0.0,
    noise: float = NOISE, crash: Sequence[float] = (),
) -> Dataset:  # fmt: skip
    """Poses (N, n) of the robot, the zero of one joint moved, rad. crash: displacement of the joint's frame, m, rad."""
    arm = made.model.mechanism
    zero = drive_effect("moved", arm.joints[joint], gp.Expression("1"))
    constants = [e for e in geometric_effects(arm) if e.slots == (f"{arm.joints[joint].name}.moving",)]
    truth = ErrorModel(arm, (*made.model.effects, zero, *(constants if crash else ())))
    dataset = unmeasured([j.name for j in arm.joints], q)
    tip = observe(truth, prepare(arm, dataset), np.array([*made.theta, moved, *crash]), placement).tip[:, :3, 3]
    return replace(dataset, position=tip + rng.normal(0.0, noise, tip.shape), source="later.csv")
