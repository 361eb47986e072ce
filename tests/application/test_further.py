"""Bounds of the errors at further poses, on poses that nobody measured for the fit."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import Truth, measure

from gpmodel.application.further import POSES, further_poses
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.model.error_model import Poses, observe, prepare
from gpmodel.table.dataset import Dataset

NOISE = 3e-5


def fresh(poses: Poses, truth: Truth, rng: np.random.Generator) -> Poses:
    """Poses anywhere within the measured ranges, measured with the same noise."""
    data: Dataset = poses.dataset.subset(rng.integers(0, len(poses), POSES))
    data = replace(data, q=rng.uniform(poses.dataset.q.min(axis=0), poses.dataset.q.max(axis=0), data.q.shape))
    there = prepare(truth.model.mechanism, data)
    tip = observe(truth.model, there, truth.theta, truth.placement).tip[:, :3, 3]
    return replace(there, dataset=replace(data, position=tip + NOISE * rng.normal(size=tip.shape)))


@pytest.mark.long
@pytest.mark.parametrize("count", [40, 100])
def test_the_bounds_hold_on_further_poses_and_are_no_wider_than_they_must(count: int) -> None:
    held, over = [], []
    for seed in range(12):
        truth = measure("ur5", (), (), seed, count=count, noise=NOISE)
        fit = calibrate(truth.model, truth.poses)
        found = further_poses(fit, truth.poses)
        assert found is not None
        errors = errors_on(fit, fresh(truth.poses, truth, np.random.default_rng(seed)))
        there = [np.sqrt(np.mean(errors**2)), np.percentile(errors, 95), errors.max()]
        bounds = [1e-3 * b.bound_mm for b in (found.rms, found.within_95, found.largest)]
        held += [t <= b for t, b in zip(there, bounds, strict=True)]
        over.append(bounds[0] / there[0])
        assert found.rms.typical_mm < found.rms.bound_mm
    assert np.mean(held) > 0.85
    assert np.median(over) < 1.3


def test_repeats_of_few_poses_are_worth_less_than_as_many_poses() -> None:
    truth = measure("ur5", (), (), 3, count=60, noise=NOISE)
    fit = calibrate(truth.model, truth.poses)
    assert fit.freedom == 180 - fit.rank
    few = truth.poses.subset(np.arange(12))
    assert further_poses(calibrate(truth.model, few), few) is None
