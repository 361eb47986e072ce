"""The sphere fit: exact points, noise, agreement with the calibrated base and tooling ball, bad input."""

import numpy as np
import pytest
from spherical_cases import JOINT, published_table

from experiments.spherical_joint.sphere_fit import algebraic_sphere, fit_sphere
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.errors import InputError
from gpmodel.model.error_model import ErrorModel, prepare

CENTRE, RADIUS = np.array([0.12388, 0.02811, -0.20564]), 0.04521


def cap(rng: np.random.Generator, count: int, half_angle: float) -> np.ndarray:
    height = rng.uniform(np.cos(half_angle), 1.0, count)
    turn = rng.uniform(0.0, 2 * np.pi, count)
    across = np.sqrt(1 - height**2)
    return CENTRE + RADIUS * np.column_stack([across * np.cos(turn), across * np.sin(turn), height])


@pytest.mark.parametrize("half_angle", [0.2, 0.8, 1.6])
def test_exact_points_give_the_sphere_back(half_angle: float) -> None:
    points = cap(np.random.default_rng(0), 31, half_angle)
    centre, radius = algebraic_sphere(points)
    fit = fit_sphere(points)
    for found_centre, found_radius in ((centre, radius), (fit.centre, fit.radius)):
        np.testing.assert_allclose(found_centre, CENTRE, atol=1e-11)
        assert found_radius == pytest.approx(RADIUS, abs=1e-11)
    assert fit.status == "converged"


def test_the_stated_uncertainty_is_the_scatter_of_the_estimates() -> None:
    rng = np.random.default_rng(1)
    points = cap(rng, 31, 1.0)
    fits = [fit_sphere(points + 2e-6 * rng.standard_normal(points.shape)) for _ in range(300)]
    scatter = np.std([[*f.centre, f.radius] for f in fits], axis=0)
    stated = np.sqrt(np.mean([f.stderr**2 for f in fits], axis=0))
    np.testing.assert_allclose(stated / scatter, 1.0, atol=0.15)
    assert np.mean([f.sigma for f in fits]) == pytest.approx(2e-6, rel=0.05)


def test_the_geometric_fit_beats_the_algebraic_start() -> None:
    rng = np.random.default_rng(2)
    points = cap(rng, 31, 0.5) + 2e-4 * rng.standard_normal((31, 3))
    centre, radius = algebraic_sphere(points)
    start = np.sum((np.linalg.norm(points - centre, axis=1) - radius) ** 2)
    assert np.sum(fit_sphere(points).residual ** 2) < start


@pytest.mark.parametrize("seed", range(4))
def test_base_and_tooling_ball_calibrate_to_the_sphere(seed: int) -> None:
    """Table 3.4: the two methods agree to numerical accuracy; here to a tenth of a nanometre."""
    _, data = published_table(seed)
    fit = fit_sphere(data.position)
    base = calibrate(ErrorModel(JOINT, ()), prepare(JOINT, data), robust=False)
    lever = base.placement.tool[""][:3, 3] + np.asarray(JOINT.tooling_ball)
    np.testing.assert_allclose(base.placement.registration[""][:3, 3], fit.centre, atol=1e-10)
    assert np.linalg.norm(lever) == pytest.approx(fit.radius, abs=1e-10)
    np.testing.assert_allclose(base.error, np.abs(fit.residual), atol=1e-9)
    assert (base.rank, base.status) == (4, "converged")


def flat() -> np.ndarray:
    return np.column_stack([np.random.default_rng(3).uniform(0, 0.05, (20, 2)), np.full(20, 0.1)])


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (cap(np.random.default_rng(4), 3, 1.0), "3 measured poses"),
        (flat(), "one plane"),
        (np.tile(CENTRE, (31, 1)), "one pose repeated 31 times"),
        (np.repeat(cap(np.random.default_rng(5), 3, 1.0), 9, axis=0), "only 3 different points"),
        (np.full((8, 3), np.nan), "expected finite"),
    ],
    ids=["three", "coplanar", "repeated", "three different", "nan"],
)
def test_points_that_determine_no_sphere_are_refused_in_one_line(points: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        fit_sphere(points, "cmm.csv")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("cmm.csv")
