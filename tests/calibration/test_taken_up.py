"""Test that a rigid motion of an instrument error is assigned to the registration."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from effect_cases import NOISE, measure, mechanism

from gpmodel.application.model_file import SavedModel, load_model, save_model, saved_model
from gpmodel.application.usable import usable
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, problem_at
from gpmodel.families.catalogue import candidates
from gpmodel.model.error_model import ErrorModel, Poses, measured_minus, observe
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import rank as ident

ARM = "ur5"
NEARLY_RIGID = ("range offset of the instrument", "eccentricity of the instrument's elevation")
TABLES: dict[str, dict[str, object]] = {
    "one set-up": {},
    "two set-ups, two tools": {"setups": 2, "tools": 2},
    "rotations": {"see": ("position", "rotation")},
}


@cache
def fitted(name: str, table: str) -> tuple[Calibration, Poses]:
    """The geometry and an error of the instrument of 3 mm or 3 mrad, fitted to a robot that has both."""
    pool = candidates(mechanism(ARM), measure(ARM, (), (), 2).poses.states)
    effects = tuple(replace(e, prior=np.inf) for e in next(c for c in pool if c.name == name).effects)
    truth = measure(ARM, effects, [3e-3] * len(effects), 2, **TABLES[table])  # type: ignore[arg-type]
    model = ErrorModel(mechanism(ARM), (*geometric_effects(mechanism(ARM)), *effects))
    return calibrate(model, truth.poses), truth.poses


def moved(saved: SavedModel, poses: Poses) -> Array:
    """Return the predicted displacement of the readings (N, m) by the instrument, with minus without it."""
    plain, read = usable(saved), usable(saved, as_measured=True)
    without, beside = (
        measured_minus(observe(s.model, poses, s.theta, s.placement), poses.dataset) for s in (plain, read)
    )
    return without - beside


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "table"),
    [
        (NEARLY_RIGID[0], "two set-ups, two tools"),
        (NEARLY_RIGID[1], "one set-up"),
        (NEARLY_RIGID[1], "rotations"),
    ],
)
def test_predictions_with_and_without_the_instrument_differ_by_what_no_rigid_motion_takes_up(
    name: str, table: str, tmp_path: Path
) -> None:
    fit, poses = fitted(name, table)
    assert fit.sigma < 1.2 * NOISE
    problem = problem_at(fit, poses)
    rows = problem.weigh(moved(saved := saved_model(fit, poses), poses))
    assert np.linalg.norm(rows) / np.sqrt(len(poses)) > NOISE
    rigid = ident.orthonormal(problem.columns[:, : problem.placement])
    assert np.linalg.norm(rigid.T @ rows) < 0.02 * np.linalg.norm(rows)
    save_model(tmp_path / "model.json", saved)
    again = load_model(tmp_path / "model.json", saved.mechanism)
    np.testing.assert_allclose(moved(again, poses), moved(saved, poses), atol=1e-12)


@pytest.mark.parametrize("table", ["one set-up", "rotations"])
def test_columns_of_effects_in_their_gauge_are_those_of_finite_differences(table: str) -> None:
    fit, poses = fitted(NEARLY_RIGID[1], table)
    step = 1e-6
    analytic = problem_at(fit, poses).columns[:, -1]
    ends = [
        measured_minus(observe(fit.model, poses, theta, fit.placement), poses.dataset)
        for theta in (fit.theta + sign * step * (np.arange(len(fit.theta)) == len(fit.theta) - 1) for sign in (1, -1))
    ]
    slope = problem_at(fit, poses).weigh((ends[1] - ends[0]) / (2 * step))
    np.testing.assert_allclose(analytic, slope, atol=2e-2 * np.abs(slope).max())


def test_a_candidate_of_the_instrument_has_the_column_that_its_fit_has() -> None:
    fit, poses = fitted(NEARLY_RIGID[1], "one set-up")
    problem, flat = problem_at(fit, poses), replace(fit.model.effects[-1], taken_up=())
    own, offered = problem.columns[:, -1], problem.effect_rows([flat], fit.model)[:, 0]
    np.testing.assert_allclose(offered, own, atol=0.03 * np.linalg.norm(own))
