"""Simulate IRB 6400R robots with undeclared effects, for Chapter 5 of Robertson (2003).

Base, joint 5 and joint 4 are compliant, every joint has an eccentricity, and the geometry has errors. The thesis prints
no sizes; these are chosen so that the largest error of the standard model is near 1.3 mm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.families import catalogue
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
from gpmodel.planning.design import Constraints
from gpmodel.planning.poses import spread_poses
from gpmodel.table.dataset import unmeasured
from robots.library import irb6400r

POSES, TRAINING = 90, 40
LOWEST_TIP = 0.3
PAYLOAD = 150.0
PAYLOAD_CENTRE = (0.35, 0.0, 0.10)
TOOL_POINT = (0.10, 0.12, 0.10)
STIFFNESS = {"base_compliance": 6e6, "joint_compliance J5": 2.5e5, "joint_compliance J4": 3.5e5}
ECCENTRICITY = np.radians(40 / 3600)
GEOMETRY = 3e-4
NOISE = 5e-5
SPREAD_OF_STIFFNESS = 0.15


@dataclass(frozen=True)
class Case:
    """One robot as measured. poses: 90 rows; train, heldout: 40 and 50 of them; stiffness: Nm/rad, the truth's own."""

    mechanism: Mechanism
    poses: Poses
    train: IntArray
    heldout: IntArray
    stiffness: dict[str, float]


def measured_robot(
    seed: int = 0, poses: int = POSES, training: int = TRAINING, springs: Mapping[str, float] = STIFFNESS
) -> Case:
    """Robot number `seed`: seed 0 has the nominal stiffnesses, every other one its own (standard deviation 15 %).

    springs: what bends, by the catalogue's names, Nm/rad.

    Pose choice, geometry, phases of the eccentricities, instrument place, split and noise differ with every seed.
    """
    rng = np.random.default_rng([6400, seed])
    mechanism = replace(irb6400r(), payload_com=np.array(PAYLOAD_CENTRE))
    q = spread_poses(mechanism, poses, rng, Constraints(np.array([[-np.inf, -np.inf, LOWEST_TIP], [np.inf] * 3])))
    joints = tuple(j.name for j in mechanism.joints)
    table = replace(unmeasured(joints, q), payload=np.full(poses, PAYLOAD))
    prepared = prepare(mechanism, table)
    effects: list[Effect] = list(geometric_effects(mechanism))
    theta = list(GEOMETRY * rng.normal(size=len(effects)))
    stiffness = {}
    for name, value in springs.items():
        stiffness[name] = value * float(np.exp(SPREAD_OF_STIFFNESS * rng.normal() * (seed > 0)))
        effects += catalogue.build(name, mechanism, prepared.states)
        theta.append(1.0 / stiffness[name])
    for joint in joints:
        phase = rng.uniform(0.0, 2.0 * np.pi)
        effects += catalogue.build(f"eccentricity {joint}", mechanism, prepared.states)
        theta += [ECCENTRICITY * np.cos(phase), ECCENTRICITY * np.sin(phase)]
    instrument = se3.exp(np.concatenate([rng.normal(0.0, 3.0, 3), rng.uniform(-1.5, 1.5, 3)]))
    tool = np.eye(4)
    tool[:3, 3] = TOOL_POINT
    truth = ErrorModel(mechanism, tuple(effects))
    tips = observe(truth, prepared, np.array(theta), Placement({"": instrument}, {"": tool}, {})).tip[:, :3, 3]
    position: Array = tips + rng.normal(0.0, NOISE, tips.shape)
    order = rng.permutation(poses)
    split = np.sort(order[:training]), np.sort(order[training:])
    return Case(mechanism, prepare(mechanism, replace(table, position=position)), *split, stiffness)
