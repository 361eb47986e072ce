"""Test `verify` on later readings of cameras, probes, bars and inclinometers."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cli_cases import one_line, run
from instrument_cases import ARM, EFFECT

import gpmodel as gp
from experiments.touches.run import EFFECTS as UNDECLARED
from gpmodel.model.instruments import with_observations
from gpmodel.table.cells import frame_of, table_text
from gpmodel.table.dataset import Dataset

POSES = {"camera": (40, 14), "hand camera": (40, 14), "planes": (90, 36), "spheres": (90, 36), "points": (80, 40),
         "bar": (120, 60), "inclinometer": (60, 24)}  # fmt: skip
"""Poses of the fit and of the table afterwards, by the instrument."""
UNITS = {"camera": ("px", 0.1), "hand camera": ("px", 0.1), "inclinometer": ("deg", 0.002)}
"""Unit and noise of a reading, where not 0.03 mm."""
SEEN = {"inclinometer": (2, 2e-3), "points": (2, 1e-3), "bar": (2, 1e-3)}
"""Joint whose zero moves, and by how much, where not J3 by half a milliradian."""


@cache
def fitted(instrument: str) -> tuple[gp.Model, Dataset]:
    """A model of the first poses of a table, and the rest of it: another session of the same robot."""
    first, rest = POSES[instrument]
    made = gp.simulate(ARM, [f"{EFFECT}=100 arcsec"], poses=first + rest, instrument=instrument,
                       geometry_sigma="0.3 mm", seed=2)  # fmt: skip
    data, a_pose = made.table, len(made.table) // (first + rest)
    fit = gp.calibrate(made.truth.mechanism, data[: first * a_pose], [EFFECT], holdout=0.0)
    return fit.model, replace(data[first * a_pose :], source="later.csv")


def moved(data: Dataset, joint: int, by: float) -> Dataset:
    """Return the readings of a robot with a moved zero, which reached the poses at other joint values."""
    return replace(data, q=data.q - by * np.eye(data.q.shape[1])[joint])


@pytest.mark.long
@pytest.mark.parametrize("instrument", POSES)
def test_a_model_that_holds_is_said_to_in_the_unit_of_the_readings(instrument: str) -> None:
    model, data = fitted(instrument)
    found = model.verify(data, tolerance="50 mm")
    unit, noise = UNITS.get(instrument, ("mm", 0.03))
    (kind,) = found.record.kinds
    assert (found.holds, found.passed, found.record.changes) == (True, True, ())
    assert (kind.unit, kind.rows) == (unit, len(data) - len(found.record.data.outliers))
    assert kind.promised == pytest.approx(kind.after, rel=0.5)
    assert kind.after < 2.5 * noise
    assert re.search(rf"Expected: [\d.]+ {unit}\.", found.verdict)


@pytest.mark.parametrize("instrument", [pytest.param(i, marks=[pytest.mark.long] * (i != "planes")) for i in POSES])
def test_a_zero_that_moved_is_named(instrument: str) -> None:
    model, data = fitted(instrument)
    joint, by = SEEN.get(instrument, (2, 5e-4))
    found = model.verify(moved(data, joint, by)).record
    first = found.changes[0]
    assert found.verdict == "drifted"
    assert f"zero of J{joint + 1}" in (first.name, *first.rivals)
    if first.name == f"zero of J{joint + 1}":
        assert abs(first.value - by) < 4 * first.stderr


@pytest.mark.long
def test_undeclared_effects_do_not_hide_that_a_zero_moved() -> None:
    made = gp.simulate(ARM, UNDECLARED, poses=136, instrument="planes", geometry_sigma="0.3 mm", noise="0.05 mm",
                       seed=1)  # fmt: skip
    model = gp.calibrate(made.truth.mechanism, made.table[:100], holdout=0.0).model
    later = replace(made.table[100:], source="later.csv")
    assert model.verify(later).holds
    assert not model.verify(moved(later, 2, 3e-3)).holds


@pytest.mark.long
def test_outliers_of_the_fit_do_not_hide_that_a_zero_moved() -> None:
    made = gp.simulate(ARM, UNDECLARED, poses=160, instrument="planes", geometry_sigma="0.3 mm", noise="0.05 mm",
                       seed=22)  # fmt: skip
    least = []
    for gross in (0.0, 2e-2):
        q = made.table[:100].q.copy()
        q[[7, 31], [1, 2]] += gross
        model = gp.calibrate(made.truth.mechanism, replace(made.table[:100], q=q), holdout=0.0).model
        found = model.verify(replace(made.table[100:], source="later.csv"))
        assert found.holds
        least.append([shown.size or np.inf for shown in found.record.visible[1:3]])
    assert np.max(np.divide(*least[::-1])) < 1.3


@pytest.mark.long
def test_a_board_that_slipped_in_the_hand_is_named() -> None:
    model, data = fitted("camera")
    board = data.described["board"]["board"]["B"]
    for shift in (0.3, 6.0):
        points = {str(r * board["columns"] + c): [c * board["pitch_mm"] - shift, r * board["pitch_mm"], 0.0]
                  for r in range(board["rows"]) for c in range(board["columns"])}  # fmt: skip
        found = model.verify(data, board={"board": {"B": {"link": "tool", "points_mm": points}}}).record
        first = found.changes[0]
        assert (found.verdict, first.name) == ("drifted", "place of board B")
        assert abs(1e3 * first.value - shift) < 4e3 * first.stderr + 0.01


@pytest.mark.long
def test_wrong_corners_are_outliers_and_no_change() -> None:
    model, data = fitted("camera")
    u = data.readings["u"].copy()
    u[[7, 90]] += 5.0
    found = model.verify(with_observations(replace(data, readings={**data.readings, "u": u}), model.mechanism))
    assert found.holds
    assert {data.row[7], data.row[90]} <= set(found.record.data.outliers)


@pytest.mark.long
def test_the_command_takes_the_files_of_the_fit_and_leaves_its_pages(tmp_path: Path) -> None:
    model, data = fitted("camera")
    model.save(tmp_path / "model.json")
    table = tmp_path / "later.csv"
    table.write_text(table_text(frame_of(data, model.mechanism)))
    done = run("verify", tmp_path / "model.json", table, "--tolerance", "2px", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.stderr
    assert "px expected" in " ".join(done.stdout.split())
    assert "Every row is within 2 px" in " ".join(done.stdout.split())
    assert run("certificate", tmp_path / "out").exit_code == 0
    assert "Pixels and degrees are converted to mm" in (tmp_path / "out" / "certificate.html").read_text()
    done = run("verify", tmp_path / "model.json", table, "--tolerance", "0.1px")
    assert done.exit_code == 3
    other = fitted("planes")[0]
    other.save(tmp_path / "other.json")
    said = one_line(run("verify", tmp_path / "other.json", table, "--board", tmp_path / "none.toml"), 2)
    assert "none.toml" in said


@pytest.mark.long
def test_a_table_of_another_instrument_is_refused_by_its_name() -> None:
    (camera, pixels), (probe, touches) = fitted("camera"), fitted("planes")
    with pytest.raises(gp.InputError, match="fitted to on_plane, so that the noise of pixel is unknown"):
        probe.verify(pixels)
    with pytest.raises(gp.InputError, match="fitted to pixel, so that the noise of on_plane is unknown"):
        camera.verify(touches)


@pytest.mark.long
def test_a_board_that_no_column_sees_is_not_passed_over() -> None:
    model, data = fitted("inclinometer")
    with pytest.raises(gp.InputError, match=r"board: later.csv has no column u or v; expected"):
        model.verify(data, board={"board": {}})
