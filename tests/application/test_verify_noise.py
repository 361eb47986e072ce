"""Test that noise of a later measurement and copied rows are no change of the machine, but the phase of a wave is."""

from dataclasses import replace

import numpy as np
import pytest
from cli_cases import robot
from instances import some
from verify_cases import NOISE, fitted_robot, placed_anew, read_later

import gpmodel as gp
from gpmodel.mechanism.branches import random_poses
from gpmodel.report.verification_words import verdict


@pytest.mark.parametrize(
    ("times", "joint"), some([(3.0, 0.0), (6.0, 0.0), (1.0, 5e-5), (1.0, 1e-4)], (3.0, 0.0), (1.0, 1e-4))
)
@pytest.mark.parametrize("seed", some([1, 2], 1))
def test_larger_noise_of_a_later_measurement_is_no_change_of_the_machine(times: float, joint: float, seed: int) -> None:
    """times: noise of positions, relative to that of the fit. joint: random error of the second joint, rad."""
    model, made = fitted_robot()
    rng = np.random.default_rng(seed)
    q = random_poses(made.model.mechanism, 30, rng)
    off = np.zeros_like(q)
    off[:, 1] = rng.normal(0.0, joint, len(q))
    table = read_later(made, q + off, placed_anew(made, rng), rng, noise=times * NOISE)
    found = model.verify(replace(table, q=q))
    assert not found.record.changes
    said = verdict(found.record)
    assert "drifted" not in said
    assert "times that of the fit" in said


def test_a_wave_whose_phase_changed_is_one_change() -> None:
    arm, made = robot(80, seed=3, noise=NOISE, effects=("eccentricity J2=4e-4 rad",))
    waves = [k for k, effect in enumerate(made.model.effects) if "eccentricity" in effect.name]
    model, rng = gp.calibrate(arm, made.dataset, ["eccentricity J2"], holdout=0.0).model, np.random.default_rng(5)
    turned = made.theta.copy()
    turned[waves] = made.theta[waves] @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    now = replace(made, theta=turned)
    found = model.verify(read_later(now, random_poses(arm, 30, rng), placed_anew(made, rng), rng))
    (change,) = found.record.changes
    assert "phase of eccentricity" in change.name
    assert change.value == pytest.approx(np.linalg.norm(turned - made.theta), abs=3 * change.stderr)


@pytest.mark.long
@pytest.mark.parametrize("times", some([2, 4], 4))
def test_copied_rows_are_one_measurement(times: int) -> None:
    model, made = fitted_robot()
    rng = np.random.default_rng(3)
    table = read_later(made, random_poses(made.model.mechanism, 20, rng), placed_anew(made, rng), rng)
    again = table.subset(np.tile(np.arange(20), times))
    once, copied = (model.verify(data).record for data in (table, again))
    assert copied.chi_square == pytest.approx(once.chi_square)
    assert copied.verdict == once.verdict
    fits = [
        gp.calibrate(made.model.mechanism, made.dataset.subset(np.tile(np.arange(60), k)), holdout=0.0)
        for k in (1, times)
    ]
    for one, other in zip(*(fit.record.parameters for fit in fits), strict=True):
        assert other.stderr == pytest.approx(one.stderr)
    assert f"are left out: {60 * (times - 1)}." in fits[1].verdict
