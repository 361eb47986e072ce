"""What chance gains: permuted residuals are as large as the noise they stand for."""

import numpy as np
import pytest
from group_cases import problem

from gpmodel.discovery.selection.by_chance import permuted
from gpmodel.discovery.selection.moves import reestimated


def test_permuted_residuals_are_as_large_as_the_noise() -> None:
    """Of few poses a fit takes a good part of the noise: what it leaves is smaller."""
    active = reestimated(problem()[0])
    trials = permuted(active, np.arange(20), np.random.default_rng(0), 400)
    explained = trials.mean(axis=1, keepdims=True)
    assert np.mean((trials - explained) ** 2) == pytest.approx(active.sigma2, rel=0.1)
