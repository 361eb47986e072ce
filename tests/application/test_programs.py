"""Compensated targets in the languages of robots, read back: they reach what the table of `compensate` reaches."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, robot, run
from scipy.spatial.transform import Rotation

from gpmodel.api.calibrate import calibrate
from gpmodel.api.model import Model
from gpmodel.application.exports import programs
from gpmodel.application.exports.program_reading import program_read
from gpmodel.errors import InputError
from gpmodel.numerics import se3

POINTS = ["x [mm]", "y [mm]", "z [mm]"]


@pytest.fixture(scope="module")
def model() -> Model:
    mechanism, made = robot(50, 3, "irb6400r", effects=("joint_compliance J2=2e-7",))
    return calibrate(mechanism, made.dataset, ["joint_compliance J2"]).model


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three targets, the second of which asks for a move beyond a limit."""
    path = tmp_path_factory.mktemp("targets") / "targets.csv"
    q = [[10, 5, 20, 30, 40, 50], [0, 0, 0, 0, 60, 399.9999999], [-100, -20, 35, -120, -50, 100]]
    pd.DataFrame(q, columns=[f"J{i + 1} [deg]" for i in range(6)]).to_csv(path, index=False)
    return path


@pytest.mark.parametrize("file", ["cell 1.mod", "cell.dat"])
def test_what_is_written_reaches_the_targets(model: Model, targets: Path, tmp_path: Path, file: str) -> None:
    model.save(tmp_path / "model.json")
    done = run("compensate", tmp_path / "model.json", targets, "--max-move", "0.5", "--out", tmp_path / file)
    assert done.exit_code == 0, done.stderr
    text = (tmp_path / file).read_text()
    in_degrees, frames = program_read(text)
    joints = {row: np.radians(values) for row, values in in_degrees.items()}
    corrected = model.compensate(targets, max_move=0.5)
    given = corrected["status"].isin(["ok", "outside the measured range"])
    assert set(joints) == set(frames) == {i + 1 for i in np.flatnonzero(given)}
    for row in sorted(set(range(1, 4)) - set(joints)):
        assert f"Row {row}: no target, {corrected['status'][row - 1]}." in text
    q = np.array([joints[row] for row in sorted(joints)])
    np.testing.assert_allclose(np.degrees(q), corrected.loc[given, [c for c in corrected if "corrected" in c]])
    headers = [f"J{i + 1} [rad]" for i in range(6)]
    reached = model.predict(pd.DataFrame(q, columns=headers))[POINTS].to_numpy()
    nominal = se3.chain(model.mechanism.transforms(np.radians(pd.read_csv(targets).to_numpy()[given])))[-1]
    placed = model.saved.placement
    wanted = 1e3 * (placed.registration[""] @ nominal @ placed.tool[""])[:, :3, 3]
    assert np.abs(reached - wanted).max() < 1e-3
    flange = se3.chain(model.mechanism.transforms(q))[-1]
    for row, frame in zip(sorted(frames), flange, strict=True):
        found = frames[row]
        assert np.abs(found[:3, 3] - frame[:3, 3]).max() < 1e-6
        assert Rotation.from_matrix(found[:3, :3] @ frame[:3, :3].T).magnitude() < 1e-7
    quarters = [[float(v) for v in said.split(",")] for said in re.findall(r"\],\[([-\d,]+),0\],\[9E9", text)]
    assert quarters == ([[np.floor(np.degrees(v[i]) / 90) for i in (0, 3, 5)] for v in q] if "MODULE" in text else [])


@pytest.mark.parametrize(("language", "format_numbers"), [("RAPID", "_numbers"), ("KRL", "_fields")])
def test_the_head_says_how_far_the_read_program_is_off(
    model: Model, targets: Path, monkeypatch: pytest.MonkeyPatch, language: programs.Language, format_numbers: str
) -> None:
    corrected = model.compensate(targets)
    assert re.search(r"Read back: joint values to \de-1\d deg or mm, frames to \de-\d+ mm and \S+ deg", (
        model.program(corrected, language)))  # fmt: skip
    whole = getattr(programs, format_numbers)
    monkeypatch.setattr(programs, format_numbers, lambda *given: re.sub(r"(\.\d)\d+", r"\1", whole(*given)))
    assert "Read back: joint values to 0." in model.program(corrected, language)


def test_names_are_those_of_a_program(model: Model, targets: Path) -> None:
    corrected = model.compensate(targets)
    for language, first in (("RAPID", "MODULE p_1_cell_ok"), ("KRL", "DEFDAT p_1_cell_ok PUBLIC")):
        assert model.program(corrected, language, "1 cell-ok").splitlines()[0] == first  # type: ignore[arg-type]


@pytest.mark.long
def test_what_is_no_list_of_targets_is_refused(model: Model, targets: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="0 columns corrected_JOINT and 6 joints"):
        model.program(pd.read_csv(targets), "RAPID")
    with pytest.raises(InputError, match="expected RAPID or KRL"):
        model.program(model.compensate(targets), "G-code")  # type: ignore[arg-type]
    model.save(tmp_path / "model.json")
    out = tmp_path / "none.mod"
    said = one_line(run("compensate", tmp_path / "model.json", targets, "--max-move", "1e-9", "--out", out), 2)
    assert "none of the 3 targets has corrected joint values" in said
    assert not out.exists()
