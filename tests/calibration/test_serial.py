"""Test that standard errors and bounds hold if neighbouring rows share noise, as with a set-up that drifts."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import measure, true_tips
from instances import some

from gpmodel.application.further import further_poses
from gpmodel.application.model_file import saved_model
from gpmodel.application.predict import point_columns
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.serial import SerialNoise, neighbours_alike
from gpmodel.model.error_model import observe, prepare

ARMS = ("gantry", "ur5", "irb6400r", "dh")
TABLES, POSES, LATER = 10, 80, 300
DRIFT, WHITE = 2e-5, 1e-5


def drifting(rng: np.random.Generator, correlation: float) -> Array:
    """Noise of the positions of a table, m: a drift with a correlation from row to row, and white noise."""
    fresh = rng.normal(size=(POSES, 3))
    drift = fresh.copy()
    for k in range(1, POSES):
        drift[k] = correlation * drift[k - 1] + np.sqrt(1.0 - correlation**2) * fresh[k]
    return DRIFT * drift + WHITE * rng.normal(size=(POSES, 3))


def judged(arm: str, correlation: float, seed: int) -> tuple[float, float]:
    """RMS true error at later poses over that of the standard errors, and true RMS distance over its 95 % bound.

    A table whose noise drifts slowly may have too few degrees of freedom for a bound; the second number is then zero.
    """
    truth = measure(arm, (), (), seed, count=POSES + LATER, noise=0.0)
    data = truth.poses.dataset.subset(np.arange(POSES))
    noise = drifting(np.random.default_rng([seed, 44]), correlation)
    poses = prepare(truth.model.mechanism, replace(data, position=data.position + noise, in_order=True))
    fit = calibrate(truth.model, poses)
    later = truth.poses.subset(np.arange(POSES, POSES + LATER))
    seen = observe(fit.model, later, fit.theta, fit.placement)
    off = seen.tip[:, :3, 3] - true_tips(truth, later)
    columns = point_columns(saved_model(fit, poses), later, seen, fit.covariance.alternatives)
    variance = np.einsum("nik,kl,nil->ni", columns, fit.covariance.predictive, columns)
    bounds = further_poses(fit, poses)
    distance = 1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1)) + 3 * (DRIFT**2 + WHITE**2))
    over = distance / bounds.rms.bound_mm if bounds else 0.0
    return float(np.sqrt(np.mean(off**2) / np.mean(variance))), over


@pytest.mark.parametrize("correlation", [0.0, 0.9])
@pytest.mark.parametrize("arm", some(ARMS, "gantry"))
def test_standard_errors_and_bounds_hold(arm: str, correlation: float) -> None:
    found = np.array([judged(arm, correlation, seed) for seed in range(TABLES)])
    assert 0.7 < np.sqrt(np.mean(found[:, 0] ** 2)) < 1.3
    assert np.sum(found[:, 1] > 1.0) <= 3
    assert np.sum(found[:, 1] == 0.0) <= 2
    assert found[:, 1].max() < 1.25


def test_the_covariance_of_all_rows_is_that_of_each_pair() -> None:
    """A dense matrix as twin, with rows missing from the table."""
    rng, noise = np.random.default_rng(0), SerialNoise(0.7, 5.0, 1.4)
    parts, rows = rng.normal(size=(30, 3, 4)), rng.choice(60, 30, replace=False)
    between = 0.7 * np.exp(-np.abs(rows[:, None] - rows[None]) / 5.0) + 0.3 * np.eye(30)
    whole = 1.4 * np.einsum("pik,pq,qil->kl", parts, between, parts)
    np.testing.assert_allclose(noise.added(parts, rows) + np.einsum("pik,pil->kl", parts, parts), whole, rtol=1e-12)


@pytest.mark.parametrize("freedom", [3.0, 1000.0])
def test_independent_rows_are_rarely_alike(freedom: float) -> None:
    """One table in a hundred is alike by chance, also with heavy tails."""
    rng = np.random.default_rng(1)
    tables = (rng.normal(size=(60, 3)) / np.sqrt(rng.chisquare(freedom, size=(60, 1))) for _ in range(1000))
    assert sum(map(neighbours_alike, tables)) <= 20
