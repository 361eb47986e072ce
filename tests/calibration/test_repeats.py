"""Errors that repeats of a pose share count once, in the numbers and in their standard errors."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import Truth, bare, measure, mechanism

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import prepare

POSES, TIMES = 24, 3
SHARED, ALONE = 4e-5, 1e-5


def repeated(seed: int, times: int = TIMES) -> Truth:
    """Poses measured several times, which share a deviation four times as large as that of a measurement."""
    single = bare("ur5", POSES, seed, payload=False)
    data = single.subset(np.tile(np.arange(POSES), times))
    data = replace(data, row=np.arange(1, len(data) + 1))
    joints = mechanism("ur5").joints
    effects = [
        drive_effect(f"{f} {j.name}", j, Expression(f"{f}({j.name})")) for j in joints[2:4] for f in ("sin", "cos")
    ]
    truth = measure("ur5", effects, [1e-3, -5e-4, 2e-4, 1e-4], seed, dataset=data, geometry=0.0, noise=ALONE)
    shared = SHARED * np.random.default_rng([seed, 9]).normal(size=(POSES, 3))
    moved = replace(truth.poses.dataset, position=truth.poses.dataset.position + np.tile(shared, (times, 1)))
    return replace(truth, poses=replace(truth.poses, dataset=moved))


def fitted(truth: Truth) -> Calibration:
    return calibrate(truth.model, truth.poses, robust=False)


@pytest.mark.long
def test_deviations_are_right_where_poses_are_repeated() -> None:
    truths = [repeated(seed) for seed in range(40)]
    scores = [(fit.theta - truth.theta) / fit.stderr for truth, fit in ((t, fitted(t)) for t in truths)]
    assert np.std(scores) == pytest.approx(1.0, abs=0.15)


def test_as_many_repeats_of_every_pose_are_their_mean() -> None:
    """The numbers, and up to the freedom left for the noise their deviations, are those of one mean a pose."""
    truth = repeated(3)
    data = truth.poses.dataset
    mean = replace(data.subset(np.arange(POSES)), position=data.position.reshape(TIMES, POSES, 3).mean(axis=0))
    of_means = calibrate(truth.model, prepare(truth.model.mechanism, mean), robust=False)
    fit = fitted(truth)
    np.testing.assert_allclose(fit.theta, of_means.theta, atol=1e-9)
    np.testing.assert_allclose(fit.stderr, of_means.stderr, rtol=0.15)
    assert of_means.freedom == 3 * POSES - of_means.rank
    assert of_means.freedom < fit.freedom < 1.5 * of_means.freedom


def test_measuring_again_adds_little_where_poses_share_most() -> None:
    """Twelve repeats of a pose are worth hardly more than three."""
    few, many = (fitted(repeated(5, times)) for times in (3, 12))
    assert np.all(many.stderr > 0.8 * few.stderr)
    assert few.pose_ratio == pytest.approx((SHARED / ALONE) ** 2, rel=0.6)


def test_poses_measured_once_have_one_level_of_noise() -> None:
    assert fitted(repeated(1, times=1)).pose_ratio == 0.0
