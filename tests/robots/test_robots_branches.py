"""Test two arms on one torso, calibrated by points that both arms touch."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, run
from torso_cases import MASS, TIPS, torso

import gpmodel as gp
from gpmodel.api.simulate import SimulationResult
from gpmodel.application.exports.make import exports_of
from gpmodel.application.exports.sample import Place
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import Weighting, linearise
from gpmodel.calibration.result import Calibration
from gpmodel.calibration.start import placement_after
from gpmodel.calibration.undeclared import SMOOTH
from gpmodel.errors import InputError
from gpmodel.families.load import base_compliance, joint_compliance
from gpmodel.mechanism.branches import assembled, moves_with, random_poses
from gpmodel.model.error_model import ErrorModel, Poses, measured_minus, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
from gpmodel.table.blocks import copies
from gpmodel.table.dataset import unmeasured
from robots.urdf import read_urdf


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("torso") / "torso.urdf"
    path.write_text(torso())
    return path


@pytest.fixture(scope="module")
def weighty(file: Path) -> Path:
    """Return the file with a kilogram in every link."""
    path = file.with_name("weighty.urdf")
    path.write_text(torso(weighty=True))
    return path


@pytest.fixture(scope="module")
def made(file: Path):  # type: ignore[no-untyped-def]
    arms = gp.load_mechanism(str(file), frame=TIPS)
    return gp.simulate(arms, poses=96, instrument="points", geometry_sigma="0.3 mm")


def test_each_arm_moves_as_the_chain_to_it(file: Path) -> None:
    arms = gp.load_mechanism(str(file), frame=TIPS)
    assert [j.name for j in arms.joints] == ["torso", *(f"{s}_{k}" for s in ("left", "right") for k in range(5))]
    assert (arms.slots[0], arms.slots[-1]) == ("base", "tool")
    q = random_poses(arms, 7, np.random.default_rng(0))
    frames, names = se3.chain(arms.transforms(q)), [j.name for j in arms.joints]
    for tip, slot in arms.bare.tips.items():
        alone = read_urdf(file, frame=tip)
        wanted = se3.chain(alone.transforms(q[:, [names.index(j.name) for j in alone.joints]]))[-1]
        np.testing.assert_allclose(frames[arms.slots.index(slot)], wanted, atol=1e-12)
    moves = moves_with(arms)
    at = arms.slots.index
    assert moves[at("torso.moving"), [at("tool"), at("right_tool.tool")]].all()
    assert moves[at("right_2.moving"), at("right_tool.tool")]
    assert not moves[at("right_2.moving"), at("tool")]


def test_columns_are_the_derivatives_of_the_gaps(made) -> None:  # type: ignore[no-untyped-def]
    data = made.table.subset(np.arange(16))
    saved, poses = made.truth.saved, prepare(made.truth.mechanism, data)
    model, theta, step = saved.model, np.array(saved.theta), 2e-6
    placement = observe(model, poses, theta, saved.placement)
    placed = type(saved.placement)(saved.placement.registration, saved.placement.tool, dict(placement.own))
    problem = linearise(model, poses, theta, placed, Weighting({}, np.ones(len(poses), dtype=bool)))
    scale, moves = problem.weights[problem.weights > 0], np.zeros(problem.columns.shape[1])
    for k in range(0, len(moves), 5):
        seen = []
        for side in (1, -1):
            moves[:] = 0.0
            moves[k] = side * step
            near = placement_after(problem.observed, placed, moves[: problem.placement])
            there = observe(model, poses, theta + moves[problem.placement :], near)
            seen.append(measured_minus(there, data)[problem.weights > 0] * scale)
        numeric = (seen[1] - seen[0]) / (2 * step)
        np.testing.assert_allclose(problem.columns[:, k], numeric, atol=1e-6 * max(np.abs(numeric).max(), 1e-3))


def gaps(fit: Calibration, poses: Poses) -> float:
    """Root mean square, m, of how far tools are from the middle of the points they share."""
    seen = observe(fit.model, poses, fit.theta, fit.placement)
    return float(np.sqrt(np.nanmean(measured_minus(seen, poses.dataset) ** 2)))


def test_points_that_both_arms_touch_calibrate_them_against_one_another(made) -> None:  # type: ignore[no-untyped-def]
    poses = prepare(made.truth.mechanism, made.table)
    assert set(made.table.label("tip")) == {"left_tool", "right_tool"}
    train, fresh = poses.subset(np.arange(72)), poses.subset(np.arange(72, 96))
    bare = calibrate(ErrorModel(made.truth.mechanism, ()), train)
    fit = calibrate(ErrorModel(made.truth.mechanism, geometric_effects(made.truth.mechanism)), train)
    assert fit.status == "converged"
    assert gaps(fit, fresh) < 0.5 * gaps(bare, fresh)


@pytest.mark.long
def test_where_the_second_arm_stands_is_fitted(file: Path) -> None:
    arms = gp.load_mechanism(str(file), frame=TIPS)
    made = gp.simulate(arms, ["right_0.fixed:Ty:1=2 mm"], poses=96, instrument="points", noise="0.02 mm")
    poses = prepare(made.truth.mechanism, made.table)
    fit = calibrate(ErrorModel(made.truth.mechanism, geometric_effects(made.truth.mechanism)), poses)
    assert gaps(fit, poses) < 0.02e-3
    assert {"right_0.fixed Ty", "left_4 Ry"} <= {e.name for e in geometric_effects(arms)}
    assert "left_0.fixed Ty" not in {e.name for e in geometric_effects(arms)}


def pairs_of(made: SimulationResult) -> pd.DataFrame:
    """Bars between the two arms at once: both rows of a pair have one set of joint values and one length."""
    points = made.table.position
    length = 1e3 * np.linalg.norm(points[::2] - points[1::2], axis=1)
    frame = made.to_dataframe().drop(columns=["x [mm]", "y [mm]", "z [mm]"])
    assert len(frame) == 2 * len(length)
    pair = np.repeat(np.arange(len(length)), 2)
    return frame.assign(pair=[f"B{k}" for k in pair], **{"length [mm]": [f"{length[k]:.6f}" for k in pair]})


def two_arms_at_once(file: Path, count: int) -> SimulationResult:
    arms = gp.load_mechanism(str(file), frame=TIPS)
    q = np.repeat(random_poses(arms, count, np.random.default_rng(0)), 2, axis=0)
    poses = pd.DataFrame({f"{j.name} [rad]": column for j, column in zip(arms.joints, q.T, strict=True)})
    return gp.simulate(arms, poses=poses.astype(str), geometry_sigma="0.3 mm", noise="0.03 mm")


@pytest.mark.long
def test_bars_between_two_arms_are_no_copies_and_cost_one_unknown_each(file: Path) -> None:
    frame = pairs_of(two_arms_at_once(file, 80))
    arms = gp.load_mechanism(str(file), frame=TIPS)
    data = gp.read_table(frame, arms)
    assert not copies(data).any()
    (touches,) = data.observations
    assert sum(map(len, touches.own.values())) == 80
    fit, bare = (calibrate(ErrorModel(arms, effects), prepare(arms, data)) for effects in (geometric_effects(arms), ()))
    assert fit.status == "converged"
    assert not len(fit.outliers)
    assert fit.error.mean() < 0.1 * bare.error.mean()


def test_a_bar_reads_its_length_and_its_columns_are_derivatives(file: Path) -> None:
    made = two_arms_at_once(file, 12)
    frame, saved = pairs_of(made), made.truth.saved
    data = gp.read_table(frame, made.truth.mechanism)
    poses = prepare(made.truth.mechanism, data)
    seen = observe(saved.model, poses, saved.theta, saved.placement)
    gap = measured_minus(seen, data)[:, -1]
    points = seen.tips.root[:, :3, 3]
    apart = np.linalg.norm(points[::2] - points[1::2], axis=1) - data.readings["length"][::2]
    np.testing.assert_allclose(np.abs(gap[::2]), 0.5 * np.abs(apart), atol=1e-12)
    np.testing.assert_allclose(gap[::2], -gap[1::2], atol=1e-12)
    problem = linearise(saved.model, poses, saved.theta, saved.placement, Weighting({}, np.ones(len(data), dtype=bool)))
    moved = saved.theta + 1e-6 * np.random.default_rng(1).normal(size=len(saved.theta))
    after = measured_minus(observe(saved.model, poses, moved, saved.placement), data)[:, -1]
    own = np.array(["pair" in name for name in problem.placement_names])
    foreseen = problem.residual - problem.columns[:, problem.placement :] @ (moved - saved.theta)
    slides = problem.columns[:, : problem.placement][:, own]
    foreseen -= slides @ np.linalg.lstsq(slides, foreseen, rcond=None)[0]
    np.testing.assert_allclose(after, foreseen, atol=1e-10)


def test_one_pose_of_two_arms_has_one_set_of_corrected_joints(file: Path) -> None:
    """Rows of one arm alone do not move the joints of the other arm."""
    made = two_arms_at_once(file, 30)
    arms = gp.load_mechanism(str(file), frame=TIPS)
    model, angles = gp.calibrate(arms, made.table, holdout=0.0).model, [f"{j.name} [deg]" for j in arms.joints]
    targets = made.to_dataframe()[[*angles, "tip", "tool"]]
    for rows in (targets, targets.iloc[::2]):
        found = model.compensate(rows)
        assert set(found["status"]) <= {"ok", "outside the measured range", "near singular"}
        assert found["residual [mm]"].astype(float).max() < 1e-3
        corrected = found[[f"corrected_{name}" for name in angles]].astype(float).to_numpy()
        moved = np.abs(corrected - rows[angles].astype(float).to_numpy())
        assert moved[:, 0].min() > 0.0
        if len(rows) == 60:
            np.testing.assert_array_equal(corrected[::2], corrected[1::2])
        else:
            assert moved[:, [angles.index(f"right_{k} [deg]") for k in range(5)]].max() < 1e-5


def test_exchanged_tips_of_a_pose_are_named(file: Path) -> None:
    made = two_arms_at_once(file, 40)
    data, rows = made.table, [10, 11, 30, 31]
    order = np.arange(len(data))
    order[rows] = order[rows].reshape(2, 2)[:, ::-1].ravel()
    arms = gp.load_mechanism(str(file), frame=TIPS)
    for table, named in ((replace(data, position=data.position[order]), True), (data, False)):
        said = [f.text for f in gp.check(arms, table).findings]
        assert any("the tools or tips of rows 11, 12, 31, 32 look exchanged" in text for text in said) == named


def test_rows_that_touch_nothing_of_a_kind_read_nothing(file: Path) -> None:
    data = gp.read_table(pairs_of(two_arms_at_once(file, 6)), gp.load_mechanism(str(file), frame=TIPS))
    (none,) = (o.subset(np.zeros(0, dtype=np.int64)) for o in data.observations)
    (half,) = (o.subset(np.array([0, 2, 3])) for o in data.observations)
    assert none.readings.shape == (0, 0)
    assert half.readings.sum(axis=1).tolist() == [0, 1, 1]


def test_each_arm_bears_its_own_weight(weighty: Path) -> None:
    arms = gp.load_mechanism(str(weighty), frame=TIPS)
    names, q = [j.name for j in arms.joints], random_poses(arms, 9, np.random.default_rng(0))
    loads, parts = arms.loads(q, np.zeros(9)), arms.bare.unit_loads(q)
    for tip, side in (("left_tool", "left"), ("right_tool", "right")):
        alone = read_urdf(weighty, frame=tip)
        own = q[:, [names.index(j.name) for j in alone.joints]]
        wanted = alone.loads(own, np.zeros(9))
        np.testing.assert_array_equal(loads[f"torque_{side}_1"], wanted[f"torque_{side}_1"])
        part = f"torque_{side}_1_of_{side}_3_x"
        np.testing.assert_array_equal(parts[part], alone.unit_loads(own)[part])


def test_a_shared_joint_bears_both_arms_and_what_they_share_once(tmp_path: Path) -> None:
    """The chest weighs as well, and the torso leans."""
    text = torso(weighty=True).replace('<link name="chest"/>', f'<link name="chest">{MASS}</link>', 1)
    file = tmp_path / "leaning.urdf"
    file.write_text(text.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 1 0"/>', 1))
    light = tmp_path / "chest.urdf"
    light.write_text(re.sub(r'<link name="(\w+_link_\d)">.*?</link>', r'<link name="\1"/>', file.read_text()))
    arms = gp.load_mechanism(str(file), frame=TIPS)
    names, q = [j.name for j in arms.joints], random_poses(arms, 9, np.random.default_rng(0))

    def alone(source: Path, tip: str) -> dict[str, Array]:
        chain = read_urdf(source, frame=tip, arms=TIPS.split(","))
        return chain.loads(q[:, [names.index(j.name) for j in chain.joints]], np.zeros(9))

    left, right, chest = alone(file, "left_tool"), alone(file, "right_tool"), alone(light, "left_tool")
    loads = arms.loads(q, np.zeros(9))
    assert np.abs(chest["torque_torso"]).max() > 0.1
    for name in ("torque_torso", "moment_torso_x", "force_base_z", "moment_base_x"):
        np.testing.assert_allclose(loads[name], left[name] + right[name] - chest[name], atol=1e-9)
    states = prepare(arms, unmeasured(names, q)).states
    offered = {c.name for family in (joint_compliance, base_compliance) for c in family(arms, states)}
    assert {"joint compliance, torso", "base compliance"} <= offered


@pytest.mark.long
def test_two_arms_by_the_commands(file: Path, tmp_path: Path) -> None:
    table, arms = tmp_path / "t.csv", ("--mechanism", file, "--frame", TIPS)
    done = run("simulate", *arms, "--instrument", "points", "--poses", 48, "--geometry-sigma", "0.3mm", "--out", table)
    assert done.exit_code == 0, done.stderr
    assert run("check", table, *arms).exit_code == 0
    done = run("calibrate", table, *arms, "--standard", "* Rz")
    assert done.exit_code == 0, done.stderr
    assert "same_point" in done.stdout
    done = run("predict", tmp_path / "t.truth.json", table)
    assert done.exit_code == 0, done.stderr
    text = table.read_text().replace("right_tool,right_tool", "third_tool,right_tool", 1)
    (tmp_path / "bad.csv").write_text(text)
    said = one_line(run("check", tmp_path / "bad.csv", *arms), 2)
    assert "'third_tool' is no tip; expected left_tool, right_tool" in said


def test_a_table_that_names_the_arm_has_a_tool_of_each(file: Path, made) -> None:  # type: ignore[no-untyped-def]
    frame = made.to_dataframe().drop(columns="tool")
    again = gp.read_table(frame, made.truth.mechanism)
    np.testing.assert_array_equal(again.label("tool"), made.table.label("tip"))


def test_what_two_arms_cannot_be_is_one_line(file: Path) -> None:
    with pytest.raises(InputError, match="expected each link once"):
        gp.load_mechanism(str(file), frame="left_tool,left_tool")
    with pytest.raises(InputError, match="no link named 'hand'"):
        gp.load_mechanism(str(file), frame="left_tool,hand")
    with pytest.raises(InputError, match="planes is of one arm"):
        gp.simulate(gp.load_mechanism(str(file), frame=TIPS), poses=12, instrument="planes")


ROWS = (
    '\nname = "{side}"\n[arm.tool]\nxyz_mm = [0, 0, 80]\n[[arm.joint]]\nname = "torso"\nd_mm = 900\n'
    'alpha_deg = {tilt}\n[[arm.joint]]\nname = "{side}_1"\nd_mm = {d}\na_mm = 400\nalpha_deg = 90\n'
)


@pytest.mark.parametrize("source", ["urdf", "rows"])
def test_arms_are_written_with_their_errors(source: str, file: Path, tmp_path: Path) -> None:
    if source == "rows":
        sides = [ROWS.format(side=s, tilt=t, d=d) for s, t, d in (("left", 20, 100), ("right", -20, -100))]
        file = tmp_path / "rows.toml"
        file.write_text('convention = "standard"\n' + "".join(f"[[arm]]{side}" for side in sides))
    arms = gp.load_mechanism(str(file), frame=TIPS if source == "urdf" else None)
    rng, slots = np.random.default_rng(2), arms.slots
    twists = {slot: 1e-3 * rng.normal(size=6) for slot in slots}
    q = random_poses(arms, 5, rng)
    errors = {i: np.broadcast_to(se3.exp(twists[slot]), (5, 4, 4)) for i, slot in enumerate(slots)}
    placed = assembled(arms.bare, arms.transforms(q), errors)
    frames = arms.bare.write_urdf(tmp_path / "written.urdf", twists)
    again = gp.load_mechanism(str(tmp_path / "written.urdf"), frame=frames)
    found = se3.chain(again.transforms(q))
    for (_, slot), (_, other) in zip(arms.bare.tips.items(), again.bare.tips.items(), strict=True):
        np.testing.assert_allclose(found[again.slots.index(other)], placed[slots.index(slot)], atol=1e-9)


@pytest.mark.long
def test_a_fit_of_two_arms_is_exported_as_a_urdf_that_says_its_own_error(made, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """Functions of undeclared effects, which it cannot hold, are named; without them it is the model."""
    saved = gp.calibrate(made.truth.mechanism, made.table).model.saved
    whole = next(e for e in exports_of(saved, Place.of(saved)).files if e.file == "calibrated.urdf")
    assert (whole.largest > 1e-9) == (whole.missing == (SMOOTH,))
    saved = replace(saved, theta=np.where([e.name == SMOOTH for e in saved.model.effects], 0.0, saved.theta))
    found = {e.file: e for e in exports_of(saved, Place.of(saved)).files}
    assert found["calibrated.urdf"].largest < 1e-9
    (tmp_path / "arms.urdf").write_text(found["calibrated.urdf"].text)
    again = gp.load_mechanism(str(tmp_path / "arms.urdf"), frame=TIPS)
    assert [j.name for j in again.joints] == [j.name for j in made.truth.mechanism.joints]
