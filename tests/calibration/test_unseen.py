"""Test that quantities without position measurements stay uncertain and no accuracy is certified."""

import re
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from instrument_cases import ARM, tool_error

import gpmodel as gp
from gpmodel.api.calibrate import CalibrationResult
from gpmodel.api.simulate import SimulationResult
from gpmodel.calibration.result import problem_at
from gpmodel.calibration.undeclared import Undeclared
from gpmodel.calibration.unobservable import errors_by_region
from gpmodel.model.error_model import observe, prepare
from gpmodel.model.instruments import with_observations
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.numerics.se3 import rotation_vector
from gpmodel.report import words

TABLES = ("inclinometer", "orientations", pytest.param("planes", marks=pytest.mark.long), "z")


def of_orientations(made: SimulationResult) -> SimulationResult:
    """Replace the positions of a table by orientations of the tool, with a noise of 0.05 mrad."""
    saved, arm = made.truth.saved, made.truth.mechanism
    tip = observe(saved.model, prepare(arm, made.table), saved.theta, saved.placement).tip
    turns = rotation_vector(tip[:, :3, :3]) + np.random.default_rng(3).normal(0.0, 5e-5, (len(tip), 3))
    table = replace(made.table, position=np.full_like(made.table.position, np.nan), rotation=turns)
    return replace(made, table=table)


def of_coordinates(made: SimulationResult, axes: str) -> SimulationResult:
    """Keep only the named coordinates of the positions, as a height gauge does."""
    position = np.where([axis in axes for axis in "xyz"], made.table.position, np.nan)
    return replace(made, table=replace(made.table, position=position))


@cache
def calibrated(kind: str) -> tuple[SimulationResult, CalibrationResult]:
    made_of = {"orientations": of_orientations, "z": partial(of_coordinates, axes="z")}
    instrument = "tracker" if kind in made_of else kind
    made = gp.simulate(ARM, poses=60, instrument=instrument, geometry_sigma="0.3 mm", seed=4)
    made = made_of[kind](made) if kind in made_of else made
    return made, gp.calibrate(ARM, made.table)


@pytest.mark.first(1)
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", TABLES)
def test_the_stated_error_contains_what_the_instrument_does_not_show(kind: str) -> None:
    made, result = calibrated(kind)
    fit, poses = result.calibrated.final, result.calibrated.poses
    unknown = Undeclared.estimated(problem_at(fit, poses), fit.model, fit.theta)
    stated = np.hypot(*errors_by_region(fit, poses, unknown)[1:]) / np.sqrt(2.0)
    if kind != "z":  # a height shows the tool point
        fit = replace(fit, placement=replace(fit.placement, tool=made.truth.saved.placement.tool))
    true = root_mean_square(tool_error(made, fit))
    assert 0.25 < true / stated < 1.25


@pytest.mark.long
@pytest.mark.parametrize("kind", TABLES[:2])
def test_constants_that_no_measurement_shows_are_not_called_redundant(kind: str) -> None:
    _, result = calibrated(kind)
    record = result.record
    redundant = re.findall(r"J\d [TR][xyz]", words.dropped(record))
    unseen = {p.name for p in record.parameters if not p.kept and p.stderr}
    assert unseen
    assert not unseen & set(redundant)


@pytest.mark.parametrize("kind", TABLES[:3])
def test_an_angle_with_a_small_standard_error_is_not_called_undetermined(kind: str) -> None:
    record = calibrated(kind)[1].record
    said = next(text for text in record.unseen if text.startswith("these measurements do not determine"))
    counted = [int(n) for n in re.findall(r"\d+", said)[:4]]
    angles = [p for p in record.parameters if p.unit == "rad" and p.stderr]
    assert counted[3] == len(angles)
    assert counted[2] <= sum(not p.kept or (p.stderr or 0.0) > 2e-4 for p in angles)


@pytest.mark.parametrize("kind", TABLES)
def test_an_accuracy_of_positions_is_not_certified_without_positions(kind: str) -> None:
    with pytest.raises(gp.InputError, match="no positions were measured"):
        gp.certificate(calibrated(kind)[1])


@pytest.mark.first(1)
@pytest.mark.parametrize(("axes", "stated"), [("x", "x"), ("z", "z"), ("xy", "xy"), ("xyz", "xyz")])
def test_the_registration_is_stated_along_measured_coordinates_only(axes: str, stated: str) -> None:
    made = of_coordinates(gp.simulate(ARM, poses=60, geometry_sigma="0.3 mm", seed=4), axes)
    record = gp.calibrate(ARM, made.table).record
    assert [p.name for p in record.placement if p.unit == "m" and p.name.startswith("registration")] == [
        f"registration {axis}" for axis in stated
    ]
    assert any("of the base" in text for text in record.unseen) == (axes != "xyz")


@pytest.mark.filterwarnings("error:All-NaN")
def test_orientations_alone_are_checked_and_say_that_they_show_no_length() -> None:
    made, result = calibrated("orientations")
    notes = " ".join(remark.text for remark in gp.check(ARM, made.table).findings)
    assert "do not determine the scale of the machine" in notes
    assert "position of the base" in notes
    assert "1 mm stands for 1 mrad" in notes
    assert " 0 mm" not in notes
    assert not [p for p in result.record.placement if p.unit == "m"]


@pytest.mark.long
def test_a_result_of_orientations_alone_has_a_report_and_predicts(tmp_path: Path) -> None:
    made, result = calibrated("orientations")
    result.report(tmp_path / "out")
    predicted = gp.load_model(tmp_path / "out" / "model.json").predict(made.table)
    assert np.isfinite(predicted["sigma [mm]"]).all()


@pytest.mark.long
def test_constants_that_no_measurement_shows_do_not_blunt_a_later_check() -> None:
    """The mounting of an inclinometer and the unseen constants of its link are uncertain together, not singly."""
    made = gp.simulate(ARM, poses=120, instrument="inclinometer", geometry_sigma="0.3 mm", seed=5)
    table, later = made.table.subset(np.arange(80)), made.table.subset(np.arange(80, 120))
    q = later.q + 1e-3 * (np.arange(6) == 2)
    moved = with_observations(replace(later, q=q), made.truth.mechanism)
    verdict = gp.verify(gp.calibrate(ARM, table).model, moved).verdict
    found = re.search(r"zero of J3 moved by −(\S+) ± (\S+) µrad", verdict)
    assert found
    size, stderr = map(float, found.groups())
    assert size == pytest.approx(1000.0, abs=3.0 * stderr)
    assert stderr < 30.0
