"""Test that an effect that a model has always lacked is distinguished from a change of the machine."""

from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot
from instances import some
from verify_cases import NOISE, placed_anew, read_later

import gpmodel as gp
from gpmodel.mechanism.branches import random_poses
from gpmodel.report.verification_words import verdict

SMALL = [
    "gear_harmonic J2=6e-5 rad", "gear_harmonic J4=1e-4 rad", "eccentricity J3=4e-5 rad", "joint_compliance J2=1e-8",
]  # fmt: skip


@pytest.mark.parametrize("effect", some(SMALL, SMALL[0]))
@pytest.mark.parametrize("seed", some([3, 4, 5], 3))
def test_an_effect_that_the_model_lacks_is_no_change(effect: str, seed: int) -> None:
    arm, made = robot(40, seed=seed, noise=NOISE, effects=(effect,))
    model, rng = gp.calibrate(arm, made.dataset, holdout=0.0).model, np.random.default_rng(seed)
    found = model.verify(read_later(made, random_poses(arm, 500, rng), placed_anew(made, rng), rng))
    assert found.record.verdict == "holds"
    assert found.record.changes
    assert all(change.of_the_model for change in found.record.changes)
    assert "do not exclude" in verdict(found.record)


@pytest.mark.parametrize("effect", some(SMALL, SMALL[0]))
@pytest.mark.parametrize("seed", some([3, 4, 5], 3))
def test_an_effect_that_the_poses_of_the_fit_exclude_is_a_change(effect: str, seed: int) -> None:
    arm, made = robot(40, seed=seed, noise=NOISE, effects=(effect,))
    own = [k for k, e in enumerate(made.model.effects) if not e.constant]
    before, after = made.theta.copy(), made.theta.copy()
    before[own], after[own] = 0.0, 4.0 * after[own]
    rng = np.random.default_rng(seed)
    clean = read_later(replace(made, theta=before), made.dataset.q, made.placement, rng)
    model = gp.calibrate(arm, clean, holdout=0.0).model
    later = read_later(replace(made, theta=after), random_poses(arm, 500, rng), placed_anew(made, rng), rng)
    found = model.verify(later)
    assert found.record.verdict == "drifted"
    assert not any(change.of_the_model for change in found.record.changes)


@pytest.mark.parametrize("effect", some(SMALL, SMALL[0]))
def test_a_change_beside_an_effect_that_the_model_lacks_is_named(effect: str) -> None:
    arm, made = robot(40, seed=3, noise=NOISE, effects=(effect,))
    model, rng = gp.calibrate(arm, made.dataset, holdout=0.0).model, np.random.default_rng(3)
    q = random_poses(arm, 500, rng)
    record = model.verify(read_later(made, q, placed_anew(made, rng), rng, joint=2, moved=2e-4)).record
    assert record.verdict == "drifted"
    (moved,) = (change for change in record.changes if not change.of_the_model)
    assert moved.name == "zero of J3"
    assert moved.value == pytest.approx(2e-4, abs=4 * moved.stderr)
