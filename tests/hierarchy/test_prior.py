"""Prior learned from a type whose machines' poses determine some effects poorly."""

import numpy as np
import pytest

from gpmodel.hierarchy.prior import Information, _expectation_maximisation


@pytest.mark.parametrize("constant", [True, False])
@pytest.mark.parametrize("sharp", [1e5, 1e8])
def test_effects_that_stand_for_one_another_stay_known_in_sum(constant: bool, sharp: float) -> None:
    rng, machines = np.random.default_rng(0), 40
    direction = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    matrix = sum(sharp * np.outer(d, d) for d in direction) * np.ones((machines, 1, 1))
    truth = np.array([0.3, 0.3, -0.5]) + 0.1 * rng.normal(size=(machines, 3))
    told = Information(matrix, np.einsum("mij,mj->mi", matrix, truth))
    mean, deviation = _expectation_maximisation(told, np.array([0, 0, 1]), np.full(3, constant))
    assert np.isfinite(deviation).all()
    assert mean[0] + mean[1] == pytest.approx(0.6, abs=3.0 * 0.15 / np.sqrt(machines))
    assert deviation[2] == pytest.approx(0.1, rel=3.0 / np.sqrt(2.0 * machines))
    assert (deviation[0] > 0.5) == (not constant)
