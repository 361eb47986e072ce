"""Test that standard errors and bounds hold if the noise of positions depends on the direction."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from effect_cases import Truth, bare, measure, true_tips
from instances import some

from gpmodel.application.further import further_poses
from gpmodel.arrays import Array
from gpmodel.calibration import gauss_newton
from gpmodel.calibration.directions import estimated_shape
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.iterate import Fitting
from gpmodel.calibration.linearise import Weighting, linearise
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.families.catalogue import candidates
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from robots import load_mechanism

NOISES = {
    "camera above the arm": np.diag([1e-5, 1e-5, 9e-5]),
    "camera in front of the arm": np.diag([1e-5, 6e-5, 1e-5]),
    "oblique camera": np.array([[3e-5, 2.9e-5, 0.0], [2.9e-5, 3e-5, 0.0], [0.0, 0.0, 1e-5]]),
    "ruler along x alone": np.diag([5e-5, 3e-6, 3e-6]),
    "tracker": 3e-5 * np.eye(3),
}
"""Factors F of the noise F z of a position, z standard normal, m."""
CASES = [(arm, noise) for arm in ("ur5", "irb6400r", "gantry", "dh") for noise in NOISES]
SHORT = ("irb6400r", "camera in front of the arm"), ("gantry", "oblique camera"), ("ur5", "tracker")


def measured(arm: str, factor: Array, seed: int, count: int = 80) -> tuple[Truth, Poses]:
    """Poses of an arm with geometric errors, measured with the noise F z."""
    truth = measure(arm, (), (), seed, count=count, noise=0.0)
    data = truth.poses.dataset
    noise = np.random.default_rng([seed, 4]).normal(size=(count, 3)) @ factor.T
    return truth, prepare(truth.model.mechanism, replace(data, position=data.position + noise))


@pytest.mark.parametrize(("arm", "noise"), some(CASES, *SHORT))
def test_standard_errors_are_the_spread_of_estimates_with_such_noise(arm: str, noise: str) -> None:
    truth, poses = measured(arm, NOISES[noise], 1)
    fit = calibrate(truth.model, poses, condition_limit=20.0, robust=False)
    problem = problem_at(fit, poses)
    columns = problem.columns[:, problem.free(fit.free)]
    errors = np.random.default_rng(3).normal(size=(1000, len(poses), 3)) @ NOISES[noise].T
    if problem.equal is not None:
        errors = np.einsum("nij,bnj->bni", problem.equal, errors)
    estimates = np.linalg.lstsq(columns, errors.reshape(1000, -1).T, rcond=None)[0][problem.placement :]
    ratio = fit.stderr[fit.free] / estimates.std(axis=1)
    seen = estimates.std(axis=1) > 1e-2 * estimates.std(axis=1).max()
    assert 0.7 < ratio[seen].min() < ratio[seen].max() < 1.4


@pytest.mark.parametrize("noise", some(NOISES, "camera above the arm"))
def test_bounds_at_further_poses_hold_with_such_noise(noise: str) -> None:
    over, typical = [], []
    for seed in range(6):
        truth, poses = measured("gantry", NOISES[noise], seed, count=60)
        fit = calibrate(truth.model, poses)
        found = further_poses(fit, poses)
        assert found is not None
        error = np.random.default_rng([seed, 5]).normal(size=(1000, 3)) @ NOISES[noise].T
        rms = 1e3 * np.sqrt(np.mean(np.sum(error**2, axis=1)))
        over.append(rms > found.rms.bound_mm)
        typical.append(rms / found.rms.typical_mm)
    assert sum(over) <= 1
    assert 0.85 < np.mean(typical) < 1.15


@pytest.mark.parametrize("freedom", [2.5, 1000.0])
def test_noise_that_does_not_depend_on_the_direction_has_no_shape(freedom: float) -> None:
    """Heavy tails do not raise the share of false shapes, one in a hundred."""
    rng, found = np.random.default_rng(0), 0
    for _ in range(400):
        residuals = rng.normal(size=(40, 3)) / np.sqrt(rng.chisquare(freedom, size=(40, 1)))
        found += estimated_shape(residuals) is not None
    assert found <= 12


def true_error(truth: Truth, poses: Poses, model: ErrorModel) -> float:
    """Mean square of the true errors, m², at all poses but the first 80, of a model fitted to the first 80."""
    fit = calibrate(model, poses.subset(np.arange(80)))
    later = poses.subset(np.arange(80, len(poses)))
    seen = observe(fit.model, later, fit.theta, fit.placement)
    return float(np.mean(np.sum((seen.tip[:, :3, 3] - true_tips(truth, later)) ** 2, axis=1)))


@pytest.mark.parametrize("arm", some(("ur5", "irb6400r", "dh"), "ur5"))
def test_weighed_coordinates_predict_better(arm: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three tables with z nine times noisier than x and y."""
    tables = [measured(arm, NOISES["camera above the arm"], seed, count=480) for seed in range(3)]
    weighed = sum(true_error(*table, table[0].model) for table in tables)
    monkeypatch.setattr(gauss_newton, "_by_direction", lambda fit, *_: fit)
    assert weighed < 0.4 * sum(true_error(*table, table[0].model) for table in tables)


@pytest.mark.parametrize("arm", some(("ur5", "irb6400r"), "irb6400r"))
def test_undeclared_effects_in_one_direction_are_no_noise(arm: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The standard model of a compliant arm predicts as well as with equal weights, over four arms."""
    tables = [compliant(arm, seed) for seed in range(4)]
    standard = ErrorModel(load_mechanism(arm), geometric_effects(load_mechanism(arm)))
    weighed = sum(true_error(truth, truth.poses, standard) for truth in tables)
    monkeypatch.setattr(gauss_newton, "_by_direction", lambda fit, *_: fit)
    assert weighed < 1.1 * sum(true_error(truth, truth.poses, standard) for truth in tables)


def compliant(arm: str, seed: int) -> Truth:
    """480 poses of an arm whose joints yield to gravity by about 0.5 mm at the tool, measured with equal noise."""
    mechanism = load_mechanism(arm)
    poses = prepare(mechanism, bare(arm, 480, seed))
    of_load = [c.effects[0] for c in candidates(mechanism, poses.states) if c.name.startswith("joint compliance")]
    return measure(arm, of_load, [2e-7] * len(of_load), seed, count=480, dataset=poses.dataset)


def weights_tried(monkeypatch: pytest.MonkeyPatch) -> list[Array]:
    """Covariances by which the coordinates are weighed in further fits, in order."""
    tried, fit = list[Array](), gauss_newton._fit

    def noted(fitting: Fitting, *others: Any) -> Calibration:
        if fitting.noise_shape is not None:
            tried.append(fitting.noise_shape)
        return fit(fitting, *others)

    monkeypatch.setattr(gauss_newton, "_fit", noted)
    return tried


def test_weights_of_the_fit_to_start_from_are_tried_first(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, poses = measured("irb6400r", NOISES["camera above the arm"], 1)
    first = calibrate(truth.model, poses)
    tried = weights_tried(monkeypatch)
    again = calibrate(truth.model, poses, start=first)
    assert tried == [first.noise_shape]
    moved = (again.theta - first.theta)[first.free] / first.stderr[first.free]
    assert np.abs(moved).max() < 0.01


def test_no_further_weights_are_tried_after_weights_with_larger_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, tried = compliant("irb6400r", 0), weights_tried(monkeypatch)
    standard = ErrorModel(load_mechanism("irb6400r"), geometric_effects(load_mechanism("irb6400r")))
    assert calibrate(standard, truth.poses.subset(np.arange(80))).noise_shape is None
    assert len(tried) == 1


def test_rows_have_equal_noise_if_coordinates_are_missing() -> None:
    """Each pose alone, with the covariance of its measured coordinates, as a twin."""
    truth = measure("ur5", (), (), 3, count=20, see=("position", "rotation"))
    shape = np.array([[0.5, 0.2, 0.1], [0.2, 0.5, -0.1], [0.1, -0.1, 2.0]])
    data = truth.poses.dataset
    position = data.position.copy()
    for row, missing in ((2, [0]), (3, [1]), (5, [0, 2]), (8, [0, 1, 2])):
        position[row, missing] = np.nan
    poses = prepare(truth.model.mechanism, replace(data, position=position))
    at = (truth.model, poses, truth.theta, truth.placement)
    use = np.arange(20) != 7
    equal, weighed = (linearise(*at, Weighting({"rotation": 0.5}, use, s)) for s in (None, shape))
    component = np.nonzero(equal.weights > 0)[1]
    for pose in np.unique(equal.pose_of_row):
        rows = np.flatnonzero(equal.pose_of_row == pose)
        own = component[rows[component[rows] < 3]]
        inverse = np.eye(len(rows))
        inverse[: len(own), : len(own)] = np.linalg.inv(np.linalg.cholesky(shape[np.ix_(own, own)]))
        np.testing.assert_allclose(weighed.columns[rows], inverse @ equal.columns[rows], atol=1e-12)
        np.testing.assert_allclose(weighed.residual[rows], inverse @ equal.residual[rows], atol=1e-15)
        np.testing.assert_allclose(weighed.coordinates(int(pose), component[rows]), np.linalg.inv(inverse), atol=1e-12)
