"""What chance gains: permuted residuals are as large as the noise they stand for."""

import numpy as np
import pytest
from group_cases import problem

from gpmodel.evidence.gain import best
from gpmodel.selection.by_chance import permuted, with_the_best
from gpmodel.selection.moves import with_optimal_variances


def test_permuted_residuals_are_as_large_as_the_noise() -> None:
    """Of few poses a fit takes a good part of the noise: what it leaves is smaller."""
    active = with_optimal_variances(problem()[0])
    trials = permuted(active, np.arange(20), np.random.default_rng(0), 400)
    explained = trials.mean(axis=1, keepdims=True)
    assert np.mean((trials - explained) ** 2) == pytest.approx(active.sigma2, rel=0.1)


def test_the_best_of_many_groups_is_that_of_all_though_most_are_not_looked_at() -> None:
    rng = np.random.default_rng(1)
    s = rng.lognormal(4.0, 3.0, (50, 4))
    q = np.sqrt(s) * rng.normal(0.0, 3.0, (30, 50, 4))
    s[3, 1] = q[:, 3, 1] = 0.0
    cap, cost, found = rng.uniform(0.5, 2.0, 50), rng.uniform(1.0, 5.0, 50), rng.uniform(0.0, 60.0, 30)
    every = best(np.tile(s, (30, 1)), q.reshape(-1, 4), np.tile(cap, 30))[0].reshape(30, 50) - cost
    expected = np.maximum(found, every.max(axis=1))
    np.testing.assert_array_equal(with_the_best(found, s, q, cap, cost), expected)
    assert 0 < np.sum(expected > found) < 30
