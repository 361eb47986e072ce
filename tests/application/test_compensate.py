"""Test that corrected joint values move the real mechanism to the nominal position."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, robot, run, write

from gpmodel.application.compensate import MAX_MOVE, cartesian_targets, compensate, joint_targets
from gpmodel.application.model_file import SavedModel, save_model, unfitted
from gpmodel.arrays import Array
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.numerics.se3 import chain, rotation_vector
from gpmodel.table.cells import frame_of
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
        made.model, made.theta, np.full(count, np.nan), unfitted(count), made.placement, {}, 3e-5, False, {},
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
    """Return the smallest singular value of the nominal tool's Jacobian (N,) by central differences, m and 0.3 m
    times rad per rad.
    """
    columns = []
    for i in range(dataset.q.shape[1]):
        step = np.zeros(dataset.q.shape[1])
        step[i] = 1e-5
        up, down = (tool_poses(saved, dataset, dataset.q + s * step, real=False) for s in (1.0, -1.0))
        turn = rotation_vector(up[:, :3, :3] @ np.swapaxes(down[:, :3, :3], 1, 2))
        columns.append(np.hstack([up[:, :3, 3] - down[:, :3, 3], 0.3 * turn]) / 2e-5)
    return np.linalg.svd(np.stack(columns, axis=2), compute_uv=False)[:, 5]


@pytest.mark.long
@pytest.mark.parametrize("name", EFFECTS)
def test_the_real_tool_is_where_the_nominal_one_was_meant_to_be(name: str) -> None:
    saved, dataset = true_model(name)
    found = compensate(saved, joint_targets(saved, dataset))
    ok = np.array([status == "ok" for status in found.status])
    given = ok | np.array([status == "near singular" for status in found.status])
    assert ok[smallest_singular_value(saved, dataset) > 0.1].all()
    assert given.all()
    wanted = tool_poses(saved, dataset, dataset.q, real=False)
    reached = tool_poses(saved, dataset, found.q, real=True)
    before = tool_poses(saved, dataset, dataset.q, real=True)
    np.testing.assert_allclose(reached[ok], wanted[ok], atol=5e-7)
    np.testing.assert_allclose(reached[:, :3, 3], wanted[:, :3, 3], atol=2e-7)
    missed = np.linalg.norm(before[:, :3, 3] - wanted[:, :3, 3], axis=1)
    np.testing.assert_allclose(found.correction, missed, rtol=1e-9)
    assert np.median(missed) > 1e-4
    assert np.abs(found.q - dataset.q).max() <= MAX_MOVE
    assert (found.turn[~ok] > 1e-6).all()


def test_near_a_singular_wrist_the_position_is_reached_within_the_limit_of_the_move() -> None:
    saved, dataset = true_model("irb6400r", 40)
    q = np.array(dataset.q)
    q[:, 4] = np.radians(np.linspace(-0.5, 0.5, 40))
    dataset = replace(dataset, q=q)
    found = compensate(saved, joint_targets(saved, dataset))
    assert set(found.status) <= {"ok", "near singular"}
    assert found.status.count("near singular") > 20
    assert np.abs(found.q - q).max() <= MAX_MOVE
    wanted, before, after = (
        tool_poses(saved, dataset, at, real=real) for at, real in ((q, False), (q, True), (found.q, True))
    )
    assert np.linalg.norm(after[:, :3, 3] - wanted[:, :3, 3], axis=1).max() < 1e-7
    turned = [np.linalg.norm(rotation_vector(x[:, :3, :3] @ np.swapaxes(wanted[:, :3, :3], 1, 2)), axis=1)
              for x in (before, after)]  # fmt: skip
    np.testing.assert_allclose(found.turn, turned[1], atol=1e-9)
    assert np.median(turned[1]) < np.median(turned[0])


def test_a_target_that_needs_more_than_the_limit_has_no_values() -> None:
    saved, dataset = true_model("irb6400r", 10)
    found = compensate(saved, joint_targets(saved, dataset), max_move=1e-6)
    assert set(found.status) == {"large move"}
    assert np.isnan(found.q).all()


def test_what_lies_beyond_the_ranges_of_the_model_is_said() -> None:
    saved, dataset = true_model("irb6400r", 20)
    ranges = {"J2": (-0.1, 0.1), "J9": (0.0, 0.0)} | {f"J{i}": (-10.0, 10.0) for i in (1, 3, 4, 5, 6)}
    found = compensate(replace(saved, ranges=ranges), joint_targets(saved, dataset))
    far = np.abs(dataset.q[:, 1]) > 0.11
    assert {found.status[k] for k in np.flatnonzero(far)} <= {"outside the measured range", "near singular"}
    assert all(found.outside[k] == "J2" for k in np.flatnonzero(far))
    assert np.isfinite(found.q).all()


@pytest.mark.parametrize("whole", [True, False])
def test_targets_in_the_root_frame_are_reached(whole: bool) -> None:
    saved, dataset = true_model("irb6400r", 8)
    wanted = tool_poses(saved, dataset, dataset.q, real=False)
    rotation = rotation_vector(wanted[:, :3, :3]) if whole else np.full((8, 3), np.nan)
    targets = replace(dataset, q=np.zeros_like(dataset.q), position=wanted[:, :3, 3].copy(), rotation=rotation)
    found = compensate(saved, cartesian_targets(saved, targets, np.random.default_rng(0)))
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


@pytest.mark.long
def test_each_row_has_a_status_and_only_good_rows_have_values(tmp_path: Path) -> None:
    saved, _ = true_model("irb6400r", 20)
    position = ["x [mm]", "y [mm]", "z [mm]"]
    targets = pd.DataFrame([[1500, 100, 1200], [9000, 0, 0]], columns=position).assign(name=["near", "far"])
    out = command(saved, targets, tmp_path)
    assert out["status"].tolist()[0] == "ok"
    assert out["status"].tolist()[1] == "not reached"
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
    assert out["status"].tolist() == ["joint limit", "joint limit"]
    assert out["corrected_J1 [deg]"].isna().all()


@pytest.mark.long
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


def test_a_model_that_remembers_needs_the_order_and_keeps_it_while_some_rows_are_solved(tmp_path: Path) -> None:
    mechanism, made = robot(30, 4, effects=(), geometry_sigma=5e-4)
    play = drive_effect("play", mechanism.joints[1], Expression("last_move_J2"))
    model = ErrorModel(mechanism, (*made.model.effects, play))
    theta = np.append(made.theta, 4e-4)
    saved = SavedModel(
        model, theta, np.full(len(theta), np.nan), unfitted(len(theta)), made.placement, {}, 3e-5, False, {}
    )
    blank = np.full((30, 3), np.nan)
    dataset = replace(made.dataset, position=blank, rotation=blank.copy(), in_order=True)
    save_model(tmp_path / "model.json", saved)
    targets = write(frame_of(dataset, mechanism).filter(regex="^J"), tmp_path / "targets.csv")
    for command in ("predict", "compensate"):
        assert "--in-order" in one_line(run(command, tmp_path / "model.json", targets), 2)
        assert run(command, tmp_path / "model.json", targets, "--in-order").exit_code == 0
    found = compensate(saved, joint_targets(saved, dataset))
    given = np.isin(found.status, ["ok", "near singular"])
    assert given.sum() > 25
    asked = prepare(mechanism, dataset)
    real = model.frames(replace(asked, transforms=mechanism.transforms(np.nan_to_num(found.q))), theta)[-1]
    wanted = chain(mechanism.transforms(dataset.q))[-1]
    tool = made.placement.tool[""]
    reached = np.linalg.norm(((real - wanted) @ tool)[given, :3, 3], axis=1)
    assert reached.max() < 2e-7
