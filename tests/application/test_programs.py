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


def numbers(text: str) -> list[float]:
    return [float(v) for v in re.findall(r"-?\d+\.?\d*(?:E\d+)?", text)]


def read_rapid(text: str) -> tuple[dict[int, np.ndarray], dict[int, tuple[np.ndarray, Rotation, list[float]]]]:
    joints, frames = {}, {}
    for row, said in re.findall(r"CONST jointtarget j(\d+):=(.*);", text):
        joints[int(row)] = np.radians(numbers(said)[:6])
    for row, said in re.findall(r"CONST robtarget p(\d+):=(.*);", text):
        v = numbers(said)
        frames[int(row)] = np.array(v[:3]) / 1e3, Rotation.from_quat(v[3:7], scalar_first=True), v[7:11]
        assert v[11:] == [9e9] * 6
    return joints, frames


def read_krl(text: str) -> tuple[dict[int, np.ndarray], dict[int, tuple[np.ndarray, Rotation, list[float]]]]:
    fields = {(kind, int(row)): dict(re.findall(r"(\w+) (-?[\d.]+)", said))
              for kind, row, said in re.findall(r"DECL GLOBAL \w+ ([jp])(\d+)=\{(.*)\}", text)}  # fmt: skip
    joints, frames = {}, {}
    for (kind, row), field in fields.items():
        v = {name: float(value) for name, value in field.items()}
        if kind == "j":
            joints[row] = np.radians([v[f"A{i + 1}"] for i in range(6)])
        else:
            turn = Rotation.from_euler("ZYX", [v["A"], v["B"], v["C"]], degrees=True)
            frames[row] = np.array([v["X"], v["Y"], v["Z"]]) / 1e3, turn, []
    return joints, frames


@pytest.mark.parametrize(("file", "read"), [("cell 1.mod", read_rapid), ("cell.dat", read_krl)])
def test_what_is_written_reaches_the_targets(model: Model, targets: Path, tmp_path: Path, file: str, read) -> None:  # type: ignore[no-untyped-def]
    model.save(tmp_path / "model.json")
    done = run("compensate", tmp_path / "model.json", targets, "--max-move", "0.5", "--out", tmp_path / file)
    assert done.exit_code == 0, done.stderr
    text = (tmp_path / file).read_text()
    joints, frames = read(text)
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
        point, turn, conf = frames[row]
        assert np.abs(point - frame[:3, 3]).max() < 1e-6
        assert (turn * Rotation.from_matrix(frame[:3, :3]).inv()).magnitude() < 1e-7
        if conf:
            assert conf[:3] == [np.floor(np.degrees(joints[row][i]) / 90) for i in (0, 3, 5)]


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
