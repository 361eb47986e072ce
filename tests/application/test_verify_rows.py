"""Test that rows of the fit, computed positions and gross errors are reported and do not verify a model."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import numbers, one_line, run, table, write

import gpmodel as gp

EVERY = table(80)
POINTS = ["x [mm]", "y [mm]", "z [mm]"]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fitted")
    gp.calibrate("irb6400r", EVERY.iloc[:55], holdout=0.0).model.save(folder / "model.json")
    return folder / "model.json"


@pytest.mark.parametrize("old", [slice(0, 25), slice(30, 55)])
def test_rows_of_the_fit_alone_are_refused(model: Path, old: slice, tmp_path: Path) -> None:
    part = write(EVERY.iloc[old], tmp_path / "part.csv")
    assert "is the table the model was fitted to" in one_line(run("verify", model, part), 2)


def test_rows_of_the_fit_in_other_units_are_refused(model: Path) -> None:
    numbers_ = EVERY.astype(float)
    other = {c.replace("[mm]", "[m]"): numbers_[c] / 1e3 for c in POINTS}
    other |= {c.replace("[deg]", "[rad]"): np.radians(numbers_[c]) for c in numbers_.columns if "[deg]" in c}
    with pytest.raises(gp.InputError, match="is the table the model was fitted to"):
        gp.verify(model, pd.DataFrame(other).iloc[:55])


@pytest.mark.long
def test_rows_of_the_fit_among_later_ones_are_left_out_and_counted(model: Path) -> None:
    mixed = gp.verify(model, EVERY.iloc[45:])
    alone = gp.verify(model, EVERY.iloc[55:])
    assert mixed.verdict.startswith("10 rows of the fit left out (1, 2, 3")
    assert mixed.record.chi_square == pytest.approx(alone.record.chi_square)
    assert alone.verdict.startswith("The model holds")


def test_positions_that_the_model_computed_are_refused(model: Path, tmp_path: Path) -> None:
    joints = EVERY.iloc[55:].drop(columns=POINTS)
    own = gp.load_model(model).predict(joints)
    made = pd.concat([joints.reset_index(drop=True), own[POINTS].astype(float).round(3)], axis=1)
    said = one_line(run("verify", model, write(made, tmp_path / "own.csv")), 2)
    assert "the positions were computed, not measured" in said


def test_a_certificate_is_offered_where_it_is_not_refused(model: Path, tmp_path: Path) -> None:
    for name, made in (("measured", EVERY), ("exact", table(80, noise=0.0))):
        said = run("verify", model, write(made.iloc[55:], tmp_path / f"{name}.csv"), "--out", tmp_path / name).output
        refused = run("certificate", tmp_path / name).exit_code
        assert (f"gpmodel certificate {tmp_path / name}" in said) == (name == "measured") == (refused == 0)


def test_positions_that_the_controller_computed_are_refused(model: Path) -> None:
    shown = table(20, seed=9, noise=0.0, geometry_sigma=0.0).astype(float)
    with pytest.raises(gp.InputError, match="these positions are computed, not measured"):
        gp.verify(model, shown.assign(**{name: shown[name].round(3) for name in POINTS}))


def test_gross_errors_are_named_before_the_model_is_said_to_hold(model: Path) -> None:
    bad = EVERY.iloc[55:].astype(dict.fromkeys(POINTS, float))
    bad.iloc[[3, 9], bad.columns.get_indexer(["x [mm]"])] = numbers(bad, "x [mm]")[[3, 9]][:, None] + 50.0
    said = gp.verify(model, bad).verdict
    assert said.startswith("2 of 25 readings left out (rows 4, 10): up to 50")
    assert "The model holds" in said
