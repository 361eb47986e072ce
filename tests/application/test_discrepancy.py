"""Test that the sigma of a prediction contains the error of the model's form."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_cases import robot
from instances import some
from model_cases import fitted, sealed

from gpmodel.application.further import with_discrepancy
from gpmodel.application.model_file import SavedModel, load_model, model_content, saved_model
from gpmodel.application.predict import coordinate_deviations, observed_by
from gpmodel.application.recheck import recheck, settled
from gpmodel.application.usable import usable
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.files import plain
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects

NOISE = 3e-5
POSES, FRESH = 60, 200


def measured(
    effects: tuple[str, ...], seed: int, stated: float | None = None, count: int = POSES, axes: int = 3
) -> tuple[SavedModel, SavedModel, Poses]:
    """A standard model with and without its discrepancy, and fresh poses where the robot truly is.

    count: number of fitted poses. axes: number of measured coordinates, x first.
    """
    mechanism, made = robot(count + FRESH, seed, effects=effects, noise=0.0)
    exact, noise = made.dataset, np.random.default_rng(seed).normal(0.0, NOISE, (count, 3))
    noise[:, axes:] = np.nan
    known = exact.subset(np.arange(count))
    poses = prepare(mechanism, replace(known, position=known.position + noise))
    fit = calibrate(ErrorModel(mechanism, geometric_effects(mechanism)), poses)
    saved = saved_model(fit, poses)
    fresh = prepare(mechanism, exact.subset(np.arange(count, count + FRESH)))
    return with_discrepancy(saved, fit, poses, noise=stated), saved, fresh


def covered(saved: SavedModel, poses: Poses, axes: int = 3) -> float:
    """Share of the coordinates, x first, within two standard deviations of where the robot is."""
    here, observed = observed_by(usable(saved), poses)
    off = observed.tip[:, :3, 3] - here.dataset.position
    return float(np.mean((np.abs(off) < 2.0 * coordinate_deviations(saved, here, observed))[:, :axes]))


@pytest.mark.parametrize("stated", [None, pytest.param(NOISE, marks=pytest.mark.long)])
def test_sigma_holds_the_error_of_a_model_that_lacks_an_effect(stated: float | None) -> None:
    made = [measured(("base_compliance=4e-8",), seed, stated) for seed in (1, 2)]
    without = np.mean([covered(saved, fresh) for _, saved, fresh in made])
    share = np.mean([covered(whole, fresh) for whole, _, fresh in made])
    assert without < 0.85
    assert 0.90 < share < 0.99


@pytest.mark.parametrize("axes", some([1, 2], 1))
def test_sigma_of_a_gauge_of_one_or_two_coordinates_holds_the_error_of_the_model(axes: int) -> None:
    made = [measured(("base_compliance=1e-7",), seed, None, 140, axes) for seed in (1, 2, 3)]
    without = np.mean([covered(saved, fresh, axes) for _, saved, fresh in made])
    share = np.mean([covered(whole, fresh, axes) for whole, _, fresh in made])
    assert without < 0.8
    assert 0.90 < share < 0.99


@pytest.mark.parametrize("column", ["temperature", "row"])
def test_sigma_holds_a_drift_that_no_joint_value_shows(column: str) -> None:
    """The zero of a joint follows a slow temperature, or the rows; the poses are random."""
    arm, made = robot(POSES + FRESH, 3, noise=0.0)
    rng, number = np.random.default_rng(3), np.arange(POSES + FRESH, dtype=float)
    warm = 20.0 + 5.0 * np.where(number < POSES, number / POSES, rng.uniform(0.0, 1.0, len(number)))
    data = replace(
        made.dataset,
        extras={"temperature": warm} if column == "temperature" else {},
        extra_units={"temperature": "degC"},
    )
    turned = data.q + 1e-4 * ((warm - 22.5) / 2.5)[:, None] * (np.arange(6) == 1)
    exact = observe(made.model, prepare(arm, replace(data, q=turned)), made.theta, made.placement).tip[:, :3, 3]
    known = prepare(arm, replace(data, position=exact + rng.normal(0.0, NOISE, exact.shape)).subset(np.arange(POSES)))
    fit = calibrate(ErrorModel(arm, geometric_effects(arm)), known)
    saved = saved_model(fit, known)
    fresh = prepare(arm, replace(data, position=exact).subset(np.arange(POSES, POSES + FRESH)))
    assert covered(saved, fresh) < 0.8
    assert covered(with_discrepancy(saved, fit, known), fresh) > 0.9


def test_sigma_of_a_complete_model_is_that_of_its_parameters() -> None:
    made = [measured((), seed) for seed in (1, 2)]
    with_it = np.mean([covered(whole, fresh) for whole, _, fresh in made])
    without = np.mean([covered(saved, fresh) for _, saved, fresh in made])
    assert without > 0.90
    assert with_it - without < 0.03
    for whole, saved, _ in made:
        assert whole.spread == pytest.approx(saved.sigma, rel=0.05)


def test_it_is_kept_in_the_model_file_and_zero_in_an_older_one(tmp_path: Path) -> None:
    saved = replace(fitted("geometry")[0], noise=2e-5, discrepancy=3e-5)
    path = tmp_path / "model.json"
    content = plain(model_content(saved))
    path.write_text(sealed(content))
    again = load_model(path)
    assert (again.noise, again.discrepancy) == (2e-5, 3e-5)
    path.write_text(sealed(content, noise_m=..., discrepancy_m=...))
    older = load_model(path)
    assert (older.noise, older.discrepancy, older.spread) == (None, 0.0, older.sigma)


@pytest.mark.long
def test_verification_expects_the_same_error() -> None:
    """χ² of fresh readings is near its degrees of freedom with the discrepancy, and far beyond them without."""
    whole, saved, fresh = measured(("base_compliance=4e-8",), 1)
    noise = np.random.default_rng(9).normal(0.0, NOISE, fresh.dataset.position.shape)
    later = replace(fresh.dataset, position=fresh.dataset.position + noise)
    ratio = [found.chi_square / found.degrees for found in (recheck(settled(m, later)) for m in (whole, saved))]
    assert ratio[0] < 1.3
    assert ratio[1] > ratio[0]
