"""Test the commands on CMM tables of the spherical joint: free angles, bad tables."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import numbers, one_line, run, write
from spherical_cases import JOINT, PUBLISHED, published_table

from gpmodel.table.cells import frame_of

OPTIONS = ("--mechanism", "spherical-joint")


def cmm(seed: int = 0, poses: int = 31) -> pd.DataFrame:
    frame = frame_of(published_table(seed, poses)[1], JOINT)
    return frame


def flat(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.assign(**{"z [mm]": "100.0"})


BAD = {
    "too few": (lambda f: f.head(3), "3 measured poses; expected at least 4"),
    "one pose": (lambda f: pd.concat([f.head(1)] * 12), "all 12 poses are equal"),
    "coplanar": (flat, "lie in one plane"),
    "an angle missing": (
        lambda f: f.drop(columns="J3 [deg]"),
        "joint column 'J3' is missing; expected J1, J2, J3, this one with [deg]",
    ),
    "angles in no unit": (lambda f: f.rename(columns={"J3 [deg]": "J3"}), "write 'J3 [deg]'"),
}


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("command", ["check", "calibrate", "discover"])
def test_a_table_that_determines_nothing_is_refused(tmp_path: Path, name: str, command: str) -> None:
    spoil, said = BAD[name]
    path = write(spoil(cmm()), tmp_path / "cmm.csv")
    out = () if command == "check" else ("--out", tmp_path / "out", "--quiet")
    assert said in one_line(run(command, path, *OPTIONS, *out), 2)
    assert not (tmp_path / "out").exists()


@pytest.mark.long
def test_calibrate_and_predict_solve_the_angles_and_add_the_residual(tmp_path: Path) -> None:
    path = write(cmm(poses=60), tmp_path / "cmm.csv")
    made = run("calibrate", path, *OPTIONS, "--out", tmp_path / "out", "--quiet")
    assert made.exit_code == 0, made.stderr
    model = tmp_path / "out" / "model.json"
    assert json.loads(model.read_text())
    fresh = cmm(seed=1, poses=50)
    fresh.loc[7, ["x [mm]", "y [mm]", "z [mm]"]] = ""
    target = tmp_path / "predicted.csv"
    assert run("predict", model, write(fresh, tmp_path / "new.csv"), "--out", target, "--quiet").exit_code == 0
    found = pd.read_csv(target)
    residual = numbers(found, "residual [um]")
    seen = np.arange(50) != 7
    assert np.sqrt(np.mean(residual[seen] ** 2)) < 1.5e6 * PUBLISHED.noise
    assert np.isnan(residual[7])
    assert found["predicted_x [mm]"].notna().all()
    moved = numbers(found, "solved_J2 [deg]") - numbers(found, "J2 [deg]")
    assert 0.1 < np.std(moved[seen]) < 1.0
    assert abs(moved[7]) < 1e-5
