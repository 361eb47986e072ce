"""Compliances where the masses are unknown or wrong, or the torque is measured: named, and down to the noise."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import NOISE, bare, measure, mechanism, sized

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.evidence.score import scores
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates
from gpmodel.mechanism.protocol import Mechanism, Weighed
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from joints import spherical_joint
from robots.chain import SerialChain

POSES = 150


def weighing(name: str, factors: str) -> Mechanism:
    """An arm as described: right masses, none at all, or each wrong by a factor of four, to either side."""
    arm = mechanism(name)
    assert isinstance(arm, SerialChain)
    scale = {"right": (1.0, 1.0), "none": (0.0, 0.0), "wrong": (0.25, 4.0)}[factors]
    links = tuple(replace(link, mass=link.mass * scale[k % 2]) for k, link in enumerate(arm.links))
    return replace(arm, links=links)


@cache
def measured(name: str, joint: int, millimetres: float = 0.5) -> Poses:
    """A robot whose one weak drive yields to its true torque."""
    data = bare(name, POSES, 6, payload=False)
    arm = mechanism(name)
    of_joint = f"joint compliance, {arm.joints[joint].name}"
    weak = next(c for c in candidates(arm, prepare(arm, data).states) if c.name == of_joint)
    return measure(name, weak.effects, sized(name, weak.effects, data, millimetres), 6, dataset=data).poses


def found(arm: Mechanism, poses: Poses) -> tuple[Candidate, float]:
    """The best of the catalogue, and the RMS of what it leaves, m."""
    poses, model = prepare(arm, poses.dataset), ErrorModel(arm, geometric_effects(arm))
    there = residual_of(calibrate(model, poses), poses, Criteria(), 0)
    pool = candidates(arm, poses.states)
    best = pool[int(np.argmax([s.nats for s in scores(there, pool)]))]
    fit = calibrate(ErrorModel(arm, (*model.effects, *best.effects)), poses)
    return best, float(np.sqrt(np.mean(fit.error**2)))


RIGHT, NONE, WRONG = {"joint_compliance"}, {"unknown_masses"}, {"unknown_masses", "wrong_masses"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "joint", "masses", "families"),
    [
        ("irb6400r", 2, "right", RIGHT), ("ur5", 1, "right", RIGHT), ("ur5", 1, "none", NONE), ("dh", 1, "none", NONE),
        ("ur5", 1, "wrong", WRONG),
    ],
)  # fmt: skip
def test_a_weak_joint_is_found_whatever_is_known_of_the_masses(
    name: str, joint: int, masses: str, families: set[str]
) -> None:
    arm = weighing(name, masses)
    best, rms = found(arm, measured(name, joint))
    assert best.family in families
    assert best.name.endswith(f", {arm.joints[joint].name}")
    assert rms < 1.15 * np.sqrt(3) * NOISE


@pytest.mark.long
def test_a_measured_torque_speaks_for_an_arm_without_masses() -> None:
    poses = measured("irb6400r", 2)
    torque = -poses.states["torque_J3"] + np.random.default_rng(0).normal(0, 3.0, POSES)
    extras = {**poses.dataset.extras, "tau_3": torque}
    data = replace(poses.dataset, extras=extras, extra_units={**poses.dataset.extra_units, "tau_3": "N*m"})
    best, rms = found(weighing("irb6400r", "none"), replace(poses, dataset=data))
    assert best.name == "joint compliance, J3"
    assert rms < 1.15 * np.sqrt(3) * NOISE


@pytest.mark.parametrize("masses", ["none", "wrong"])
def test_an_innocent_robot_yields_to_no_unknown_mass(masses: str) -> None:
    arm = weighing("irb6400r", masses)
    poses = prepare(arm, measure("irb6400r", (), (), 6, count=POSES).poses.dataset)
    there = residual_of(calibrate(ErrorModel(arm, geometric_effects(arm)), poses), poses, Criteria(), 0)
    mine = [c for c in candidates(arm, poses.states) if c.family.endswith("_masses")]
    assert len(mine) >= 5
    assert max(s.nats for s in scores(there, mine)) < 5.0


@pytest.mark.long
def test_only_mechanisms_that_weigh_their_parts_are_offered_unknown_masses() -> None:
    free = spherical_joint()
    assert not isinstance(free, Weighed)
    loaded = MechanismChoice("spherical-joint").load()
    assert loaded.unit_loads(np.zeros((2, len(free.joints)))) == {}
    for each in (free, loaded):
        offered = candidates(each, prepare(each, bare("spherical-joint", 20)).states)
        assert not any(c.family.endswith("_masses") for c in offered)
    arm = MechanismChoice("ur5").load()
    assert any(c.family == "unknown_masses" for c in candidates(arm, prepare(arm, bare("ur5", 20)).states))
