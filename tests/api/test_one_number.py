"""The errors that a result states are those of its model.json, loaded and asked by the public API."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import numbers, table

import gpmodel as gp
from gpmodel.api.calibrate import CalibrationResult
from gpmodel.api.model import Model
from gpmodel.application.heldout import unseen_of
from gpmodel.application.model_file import saved_model
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.report.certificate import errors_before_and_after

EXACT = 1e-6
"""Millimetres."""


def _parted(frame: pd.DataFrame, column: str) -> pd.DataFrame:
    return frame.assign(**{column: np.where(np.arange(len(frame)) % 2, "A", "B")})


CASES: dict[str, tuple[Callable[[], pd.DataFrame], tuple[str, ...], bool]] = {
    "arm": (lambda: table(44, name="ur5"), (), False),
    "set-ups": (lambda: _parted(table(60, name="ur5"), "setup"), (), False),
    "tools": (lambda: _parted(table(60, name="ur5"), "tool"), (), False),
    "payload": (lambda: table(44, payload=np.linspace(0.0, 60.0, 44)), ("base_compliance",), False),
    "instrument": (lambda: table(44, name="ur5"), ("instrument_range",), True),
}
"""Tables, the effects of their calibration, and whether plain predictions differ from readings."""


@cache
def made(case: str) -> tuple[pd.DataFrame, CalibrationResult]:
    build, effects, _ = CASES[case]
    frame = build()
    return frame, gp.calibrate("irb6400r" if case == "payload" else "ur5", frame, effects)


def errors(model: Model, frame: pd.DataFrame, rows: np.ndarray, session: bool) -> np.ndarray:
    """3-D error, mm, of the predictions of some rows, of which all are predicted."""
    found = model.predict(frame, session=session)
    measured = np.column_stack([numbers(frame, f"{a} [mm]") for a in "xyz"])
    predicted = np.column_stack([found[f"predicted_{a} [mm]"] for a in "xyz"])
    return np.asarray(np.linalg.norm(measured - predicted, axis=1)[rows])


SLOW = {"tools", "payload"}


@pytest.mark.parametrize("case", [pytest.param(c, marks=pytest.mark.long) if c in SLOW else c for c in CASES])
def test_report_and_certificate_state_the_errors_of_the_saved_model(case: str, tmp_path: Path) -> None:
    frame, result = made(case)
    ladder, record = result.calibrated, result.record
    held = np.setdiff1d(np.arange(len(frame)), ladder.train)
    result.model.save(tmp_path / "model.json")
    whole = gp.load_model(tmp_path / "model.json")
    without = Model(saved_model(ladder.steps[-1].calibration, ladder.poses.subset(ladder.train)))
    without.save(tmp_path / "without.json")
    without = gp.load_model(tmp_path / "without.json")
    everything, said = np.arange(len(frame)), record.predicted
    assert said is not None
    for model, rows, session, stated in (
        (without, held, True, record.ladder[-1].heldout),
        (without, held, True, said.heldout_as_measured),
        (without, held, False, said.heldout),
        (whole, everything, True, said.model_as_measured),
        (whole, everything, False, said.model),
    ):
        found = errors(model, frame, rows, session)
        assert stated.rms_mm == pytest.approx(root_mean_square(found), abs=EXACT)
        assert stated.max_mm == pytest.approx(found.max(), abs=EXACT)
    certified = errors_before_and_after(record)
    assert certified is not None
    stated_after = np.sort(certified[:, 1])
    assert stated_after == pytest.approx(np.sort(errors(without, frame, held, True)), rel=1e-5)
    assert said.differs is CASES[case][2]
    assert ("predict without an option" in result.summary()) is CASES[case][2]


@pytest.mark.long
def test_a_choice_in_folds_states_the_errors_of_each_model_at_the_poses_it_has_not_seen(tmp_path: Path) -> None:
    frame = table(60, name="ur5")
    result = gp.discover("ur5", frame, folds=3, search=gp.Search(runs=0), candidates=gp.catalogue[:1])
    found = np.full(len(frame), np.nan)
    for part in unseen_of(result.found):
        Model(saved_model(part.fit, part.seen)).save(tmp_path / "part.json")
        rows = part.unseen.dataset.row - 1
        found[rows] = errors(gp.load_model(tmp_path / "part.json"), frame, rows, True)
    assert len(unseen_of(result.found)) == 3
    assert result.record.ladder[-1].heldout.rms_mm == pytest.approx(root_mean_square(found), abs=EXACT)
    result.model.save(tmp_path / "model.json")
    whole = errors(gp.load_model(tmp_path / "model.json"), frame, np.arange(len(frame)), False)
    assert result.record.predicted is not None
    assert result.record.predicted.model.rms_mm == pytest.approx(root_mean_square(whole), abs=EXACT)
