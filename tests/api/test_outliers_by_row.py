"""Every command names the rows that its fits left out as outliers, by the number they have in the table."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import pandas as pd
import pytest
from cli_cases import numbers, table

import gpmodel as gp
from gpmodel.calibration.result import without_outlier_marks
from gpmodel.report.schema import Report

SPOILED = (7, 36, 61)
"""Rows of the table, from 1."""


@cache
def spoiled() -> pd.DataFrame:
    frame = table(70, name="ur5")
    for row in SPOILED:
        frame.loc[row - 1, "x [mm]"] = f"{numbers(frame, 'x [mm]')[row - 1] + 5.0:.6f}"
    return frame


COMMANDS: dict[str, Callable[[], Report]] = {
    "calibrate": lambda: gp.calibrate("ur5", spoiled()).record,
    "discover": lambda: (
        gp.discover("ur5", spoiled(), holdout=0.3, search=gp.Search(runs=0), candidates=gp.catalogue[:1]).record
    ),
    "evolve": lambda: gp.evolve("ur5", spoiled(), space="slot", runs=1, population=16, generations=1, workers=1).record,
}


SLOW = pytest.param("discover", marks=pytest.mark.long)


@pytest.mark.long
@pytest.mark.parametrize("command", [SLOW if command == "discover" else command for command in COMMANDS])
def test_outliers_are_rows_of_the_table(command: str) -> None:
    report = COMMANDS[command]()
    held = {row for row, held in zip(report.plots.rows, report.plots.heldout_mask, strict=True) if held}
    expected = set(SPOILED) - held if command == "evolve" else set(SPOILED)
    assert expected
    assert set(report.data.outliers) == expected


def test_a_fit_to_training_poses_names_what_it_left_out_though_the_final_fit_did_not() -> None:
    """The errors of the ladder are those of the fit to training poses."""
    made = gp.calibrate("ur5", spoiled()).calibrated
    ladder = replace(made, final=without_outlier_marks(made.final))
    rows = made.poses.dataset.row[ladder.outliers].tolist()
    assert rows == [row for row in SPOILED if row - 1 in made.train]


@pytest.mark.long
def test_a_compensator_starts_from_the_least_squares_model_of_every_training_pose() -> None:
    """Otherwise it gains by taking back what the fit gave up on the poses it left out."""
    result = gp.evolve("ur5", spoiled(), runs=1, population=40, generations=1, workers=1)
    assert not len(result.fit.outliers)
    assert result.record.data.outliers == ()
