"""Corrected joint values: with them the real mechanism is where the nominal one was meant to be."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, robot, run, write

from gpmodel.application.compensate import compensate_joints, compensate_targets
from gpmodel.application.model_file import SavedModel, save_model
from gpmodel.arrays import Array
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.numerics.se3 import chain, rotation_vector
from gpmodel.table.dataset import Dataset

EFFECTS = {
    "irb6400r": ("base_compliance=3e-7", "gear_harmonic J4=60 arcsec", "J3.moving:Ry:sin(40*J3)=0.1 mrad"),
    "ur5": ("J2.moving:Rx:cos(J2)=0.3 mrad".replace("J2", "shoulder_lift_joint"),),
    "panda": (),
}


def true_model(name: str, poses: int = 30) -> tuple[SavedModel, Dataset]:
    mechanism, made = robot(poses, 4, name, effects=EFFECTS[name], geometry_sigma=5e-4)
    count = len(made.theta)
    saved = SavedModel(
        made.model, made.theta, np.full(count, np.nan), np.zeros((count, count)), made.placement, 1.0, 3e-5, False, {},
    )  # fmt: skip
    middle = np.array([(j.lower + j.upper) / 2 for j in mechanism.joints])
    q = middle + 0.9 * (made.dataset.q - middle)
    blank = np.full((poses, 3), np.nan)
    return saved, replace(made.dataset, q=q, position=blank, rotation=blank.copy())


def tool_poses(saved: SavedModel, dataset: Dataset, q: Array, *, real: bool) -> Array:
    """Tool frames in the root frame, of the real mechanism or the nominal one."""
    poses = prepare(saved.mechanism, replace(dataset, q=np.array(q)))
    frames = (
        ErrorModel(saved.mechanism, saved.model.effects).frames(poses, saved.theta) if real else chain(poses.transforms)
    )
    return frames[-1] @ saved.placement.tool[""]


def smallest_singular_value(saved: SavedModel, dataset: Dataset) -> Array:
    """Of the nominal tool's Jacobian (N,) by central differences, m and 0.3 m times rad per rad."""
    columns = []
    for i in range(dataset.q.shape[1]):
        step = np.zeros(dataset.q.shape[1])
        step[i] = 1e-5
        up, down = (tool_poses(saved, dataset, dataset.q + s * step, real=False) for s in (1.0, -1.0))
        turn = rotation_vector(up[:, :3, :3] @ np.swapaxes(down[:, :3, :3], 1, 2))
        columns.append(np.hstack([up[:, :3, 3] - down[:, :3, 3], 0.3 * turn]) / 2e-5)
    return np.linalg.svd(np.stack(columns, axis=2), compute_uv=False)[:, 5]


@pytest.mark.parametrize("name", EFFECTS)
def test_the_real_tool_is_where_the_nominal_one_was_meant_to_be(name: str) -> None:
    saved, dataset = true_model(name)
    found = compensate_joints(saved, dataset)
    ok = np.array([status == "ok" for status in found.status])
    assert ok[smallest_singular_value(saved, dataset) > 0.01].all()
    assert ok.mean() > 0.8
    assert np.isnan(found.q[~ok]).all()
    wanted = tool_poses(saved, dataset, dataset.q, real=False)
    reached = tool_poses(saved, dataset.subset(ok), found.q[ok], real=True)
    before = tool_poses(saved, dataset, dataset.q, real=True)
    np.testing.assert_allclose(reached, wanted[ok], atol=2e-7)
    missed = np.linalg.norm(before[:, :3, 3] - wanted[:, :3, 3], axis=1)
    np.testing.assert_allclose(found.correction, missed, rtol=1e-9)
    assert np.median(missed) > 1e-4


@pytest.mark.parametrize("whole", [True, False])
def test_targets_in_the_root_frame_are_reached(whole: bool) -> None:
    saved, dataset = true_model("irb6400r", 8)
    wanted = tool_poses(saved, dataset, dataset.q, real=False)
    rotation = rotation_vector(wanted[:, :3, :3]) if whole else np.full((8, 3), np.nan)
    targets = replace(dataset, q=np.zeros_like(dataset.q), position=wanted[:, :3, 3].copy(), rotation=rotation)
    found = compensate_targets(saved, targets, np.random.default_rng(0))
    assert found.status == ("ok",) * 8
    reached = tool_poses(saved, dataset, found.q, real=True)
    np.testing.assert_allclose(reached[:, :3, 3], wanted[:, :3, 3], atol=2e-7)
    assert (np.abs(reached[:, :3, :3] - wanted[:, :3, :3]).max() < 1e-6) == whole
    for joint, values in zip(saved.mechanism.joints, found.q.T, strict=True):
        assert joint.lower <= values.min() <= values.max() <= joint.upper


def command(saved: SavedModel, frame: pd.DataFrame, folder: Path) -> pd.DataFrame:
    save_model(folder / "model.json", saved)
    result = run("compensate", folder / "model.json", write(frame, folder / "targets.csv"))
    assert result.exit_code == 0, result.stderr
    return pd.read_csv(io.StringIO(result.stdout))


def test_each_row_has_a_status_and_only_good_rows_have_values(tmp_path: Path) -> None:
    saved, _ = true_model("irb6400r", 20)
    position = ["x [mm]", "y [mm]", "z [mm]"]
    targets = pd.DataFrame([[1500, 100, 1200], [9000, 0, 0]], columns=position).assign(name=["near", "far"])
    out = command(saved, targets, tmp_path)
    assert out["status"].tolist()[0] == "ok"
    assert out["status"].tolist()[1].startswith("not reached")
    corrected = [c for c in out.columns if c.startswith("corrected_")]
    assert corrected == [f"corrected_J{i} [deg]" for i in range(1, 7)]
    assert out[corrected].notna().all(axis=1).tolist() == [True, False]
    assert out["name"].tolist() == ["near", "far"]


def test_limits_are_respected(tmp_path: Path) -> None:
    saved, _ = true_model("irb6400r", 20)
    lower = np.degrees([j.lower for j in saved.mechanism.joints])
    upper = np.degrees([j.upper for j in saved.mechanism.joints])
    corners = pd.DataFrame([lower, upper], columns=[f"J{i} [deg]" for i in range(1, 7)])
    out = command(saved, corners, tmp_path)
    assert all(text.startswith("beyond the limit of J") for text in out["status"])
    assert out["corrected_J1 [deg]"].isna().all()


@pytest.mark.parametrize(
    ("header", "row", "said"),
    [
        ("a [mm],b [mm]", "1,2", "no targets"),
        ("x [mm],y [mm],z [mm]", "1,,3", "row 1: x, y or z is empty"),
        ("x,y,z", "1,2,3", "no unit"),
        ("J1 [deg],J2 [deg]", "1,2", "'J3' is missing"),
    ],
)
def test_bad_targets_are_one_line(header: str, row: str, said: str, tmp_path: Path) -> None:
    saved, _ = true_model("irb6400r", 20)
    save_model(tmp_path / "model.json", saved)
    (tmp_path / "targets.csv").write_text(f"{header}\n{row}\n")
    line = one_line(run("compensate", tmp_path / "model.json", tmp_path / "targets.csv", "--out", tmp_path / "o"), 2)
    assert said in line
    assert not (tmp_path / "o").exists()
