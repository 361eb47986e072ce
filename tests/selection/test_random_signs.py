"""Test that residuals with random signs are as large as the noise, and keep its size at each pose."""

import numpy as np
import pytest
from group_cases import bars, problem

from gpmodel.evolution.variances import best
from gpmodel.selection.result import running_maximum, with_random_signs
from gpmodel.selection.sparse_bayes import reestimate
from gpmodel.table.blocks import repeat_blocks


def test_residuals_with_random_signs_are_as_large_as_the_noise() -> None:
    """With few poses a fit absorbs a good part of the noise, so that the residual is smaller."""
    active = reestimate(problem()[0])
    trials = with_random_signs(active, np.arange(20), np.random.default_rng(0), 400)
    explained = trials.mean(axis=1, keepdims=True)
    assert np.mean((trials - explained) ** 2) == pytest.approx(active.sigma2, rel=0.1)


@pytest.mark.long
def test_of_bars_the_random_residuals_are_as_large_as_the_noise_that_their_places_leave() -> None:
    """Five of the six numbers of a bar place it, what is left of a bar another does not; a tool is common to all."""
    active, poses, _ = bars()
    trials = with_random_signs(active, repeat_blocks(poses.dataset), np.random.default_rng(0), 50)
    explained = active.pool.rows.target - active.left
    left = active.pool.rows.clean(trials - explained[:, None])
    freedom = active.pool.rows.freedom
    assert freedom == 60 - 3
    assert np.mean(np.sum(left**2, axis=0)) == pytest.approx(freedom * active.sigma2, rel=0.1)


def test_each_pose_keeps_the_size_and_the_direction_of_its_residual() -> None:
    active = reestimate(problem()[0])
    explained = active.pool.rows.target - active.left
    trials = with_random_signs(active, np.arange(20), np.random.default_rng(0), 8) - explained[:, None]
    ratio = trials / active.left[:, None]
    np.testing.assert_allclose(np.abs(ratio), np.abs(ratio[0, 0]))
    sign = np.sign(ratio)
    for pose in range(20):
        rows = active.pool.rows.pose_of_row == pose
        assert (sign[rows] == sign[rows][0]).all()
    assert 0.3 < np.mean(sign > 0) < 0.7


def test_the_best_of_many_groups_is_that_of_all_though_most_are_not_looked_at() -> None:
    rng = np.random.default_rng(1)
    s = rng.lognormal(4.0, 3.0, (50, 4))
    q = np.sqrt(s) * rng.normal(0.0, 3.0, (30, 50, 4))
    s[3, 1] = q[:, 3, 1] = 0.0
    cap, cost, found = rng.uniform(0.5, 2.0, 50), rng.uniform(1.0, 5.0, 50), rng.uniform(0.0, 60.0, 30)
    every = best(np.tile(s, (30, 1)), q.reshape(-1, 4), np.tile(cap, 30))[0].reshape(30, 50) - cost
    expected = np.maximum(found, every.max(axis=1))
    np.testing.assert_array_equal(running_maximum(found, s, q, cap, cost), expected)
    assert 0 < np.sum(expected > found) < 30
