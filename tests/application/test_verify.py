"""Test that `verify` accepts a valid model, names a change, and is wrong in one case of a hundred."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, robot, run
from scipy import stats
from verify_cases import NOISE, Fitted, fitted_robot, placed_anew, read_later

import gpmodel as gp
from gpmodel.application.recheck import recheck, settled
from gpmodel.application.usable import usable
from gpmodel.mechanism.branches import random_poses
from gpmodel.model.error_model import observe, prepare
from gpmodel.planning.simulate import Simulation, simulate
from gpmodel.table.cells import frame_of, table_text
from gpmodel.table.dataset import Dataset, unmeasured


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    return fitted_robot()


@pytest.fixture(scope="module")
def accurate() -> Fitted:
    """A machine whose nominal geometry is wrong by little more than the noise."""
    return fitted_robot(geometry_sigma=5e-5)


@pytest.fixture(scope="module")
def wrist() -> Fitted:
    """A machine whose last joint follows the joint before it."""
    coupling = "J6.moving:Rz:J5"
    arm, made = robot(80, seed=3, noise=NOISE, effects=(f"{coupling}=2e-3",))
    return gp.calibrate(arm, made.dataset, [coupling], holdout=0.0).model, made


def later(
    made: Simulation, seed: int, count: int = 20, *, joint: int = 0, moved: float = 0.0, tool: float = 0.0,
    crash: Sequence[float] = (),
) -> Dataset:  # fmt: skip
    """Poses of the same robot from another place of the instrument."""
    rng = np.random.default_rng(seed)
    placement = placed_anew(made, rng, tool)
    return read_later(made, random_poses(made.model.mechanism, count, rng), placement, rng, joint, moved, crash=crash)


@pytest.mark.long
def test_while_the_model_holds_chances_are_uniform(fitted: Fitted) -> None:
    """Chances of the whole residual and of every pose, over forty later sessions of twenty poses."""
    model, made = fitted
    found = [recheck(settled(usable(model.saved), later(made, seed))) for seed in range(40)]
    assert stats.kstest([f.chance for f in found], "uniform").pvalue > 0.01
    by_pose = np.concatenate([f.by_pose[1] for f in found])
    assert np.mean(by_pose < 0.1) == pytest.approx(0.1, abs=0.04)
    errors = np.concatenate([f.session.errors for f in found])
    promised = np.concatenate([f.by_pose[0] for f in found])
    assert np.mean(errors**2) / np.mean(promised**2) == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
def test_sizes_of_two_changes_are_those_of_a_common_fit(fitted: Fitted) -> None:
    """A zero and a tool that slipped: the first change named must not absorb a part of the second."""
    model, made = fitted
    off = []
    for seed in range(6):
        found = {c.name: c for c in model.verify(later(made, seed, joint=4, moved=1e-3, tool=3e-4)).record.changes}
        if found.keys() == {"displacement of J5"}:  # includes both, and fits the noise of one session better
            continue
        zero, tool = found["zero of J5"], found["tool point"]
        off += [(zero.value - 1e-3) / zero.stderr, (tool.value - 3e-4) / tool.stderr]
    assert len(off) >= 10
    assert np.sqrt(np.mean(np.square(off))) < 1.7


@pytest.mark.first(1)
@pytest.mark.parametrize("joint", [1, 2, 3])
def test_a_frame_that_a_crash_displaced_is_one_change(fitted: Fitted, joint: int) -> None:
    """Six constants of one frame change: one change and no series of zeros and lengths, repaired by its constants."""
    model, made = fitted
    found = model.verify(later(made, 5, joint=joint, crash=(6e-4, -5e-4, 4e-4, 1e-3, -8e-4, 1.2e-3)))
    assert [c.name for c in found.record.changes] == [f"displacement of J{joint + 1}"]
    (change,) = found.record.changes
    assert change.unit == "m"
    assert abs(change.value - 1e-3 * np.sqrt(0.36 + 0.25 + 0.16)) < 4 * change.stderr


SCARA = """
convention = "modified"
[[joint]]
d_mm = 400
[[joint]]
a_mm = 350
[[joint]]
a_mm = 300
alpha_deg = 180
kind = "prismatic"
[[joint]]
"""
"""Parallel axes: the registration absorbs the height of the tool point, which has a standard error of a metre."""


def test_what_the_registration_absorbs_is_no_expected_error(tmp_path: Path) -> None:
    (tmp_path / "scara.toml").write_text(SCARA)
    arm = gp.load_mechanism(str(tmp_path / "scara.toml"))
    rng = np.random.default_rng(0)
    q = rng.uniform((-2.0, -2.0, 0.0, -3.0), (2.0, 2.0, 0.2, 3.0), (120, 4))
    made = simulate(arm, q, (), rng, noise=NOISE)
    first, second = (made.dataset.subset(np.arange(start, start + 60)) for start in (0, 60))
    saved = gp.calibrate(arm, first, holdout=0.0).model.saved
    assert float(np.diag(saved.covariance.values).max()) > 0.1
    promised, _ = recheck(settled(usable(saved), second)).by_pose
    assert np.sqrt(np.mean(promised**2)) == pytest.approx(np.sqrt(3.0) * NOISE, rel=0.2)


@pytest.mark.long
def test_a_model_that_holds_is_said_to(fitted: Fitted) -> None:
    model, made = fitted
    found = model.verify(later(made, 1), tolerance="0.2 mm")
    assert (found.holds, found.passed, found.record.changes) == (True, True, ())
    assert found.record.after.rms_mm < 0.06 < 0.3 < found.record.without.rms_mm
    assert not model.verify(later(made, 1), tolerance="0.02 mm").passed
    assert list(found.to_dataframe()["with [mm]"]) == sorted(found.to_dataframe()["with [mm]"], reverse=True)


@pytest.mark.long
def test_an_instrument_that_wanders_meanwhile_is_no_change_of_the_machine(fitted: Fitted) -> None:
    """A random walk along the rows is named as the set-up's; a zero that moved beside it is found."""
    model, made = fitted
    kinds, verdicts = [], []
    for seed in range(8):
        data, rng = later(made, seed, 60, joint=2, moved=1e-4 * (seed % 2)), np.random.default_rng([seed, 5])
        walk = np.cumsum(rng.normal(size=(60, 3)), axis=0)
        walk *= 2 * NOISE / (walk - walk.mean(axis=0)).std()
        result = model.verify(replace(data, position=data.position + walk))
        kinds.append({c.kind for c in result.record.changes})
        verdicts.append(result.record.verdict)
        assert ("instrument changed, not the machine: " in result.verdict) == ("set-up" in kinds[-1])
    assert sum("set-up" in k for k in kinds) >= 6
    assert verdicts[::2].count("holds") >= 3
    assert verdicts[1::2] == ["drifted"] * 4


@pytest.mark.long
def test_a_zero_that_moved_is_named_with_its_size(fitted: Fitted) -> None:
    model, made = fitted
    for joint, moved in ((1, 1e-4), (2, -1e-4), (2, 5e-3)):
        found = model.verify(later(made, 2, joint=joint, moved=moved))
        first = found.record.changes[0]
        assert (found.record.verdict, first.name) == ("drifted", f"zero of J{joint + 1}")
        assert abs(first.value - moved) < 4 * first.stderr
        assert f"zero of J{joint + 1} moved by" in found.verdict


@pytest.mark.long
def test_a_tool_that_slipped_or_is_another_one_is_named(fitted: Fitted) -> None:
    model, made = fitted
    for slip in (2e-4, 0.05):
        found = model.verify(later(made, 4, tool=slip))
        assert [c.name for c in found.record.changes] == ["tool point"]
        assert abs(found.record.changes[0].value - slip) < 5 * found.record.changes[0].stderr


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("joint", "moved", "slip", "first", "instead"),
    [(0, 0.0, 3e-4, "tool point", "J6 Tx"), (5, 2e-3, 0.0, "zero of J6", "tool point"),
     (1, 2e-4, 0.0, "zero of J2", "J2 Tx")],
)  # fmt: skip
def test_changes_that_no_pose_distinguishes_are_one_with_all_their_names(
    wrist: Fitted, joint: int, moved: float, slip: float, first: str, instead: str
) -> None:
    """The coupling of the wrist turns a shift of the last link by less than the noise against one of the tool point."""
    model, made = wrist
    for seed in range(4):
        found = model.verify(later(made, seed, joint=joint, moved=moved, tool=slip))
        assert [c.name for c in found.record.changes] == [first]
        assert instead in found.record.changes[0].rivals
        assert f"; may instead be {', or '.join(found.record.changes[0].rivals)}." in found.verdict


@pytest.mark.first(1)
@pytest.mark.parametrize("slip", [4e-4, 7e-4, 2e-2])
def test_a_tolerance_counts_the_error_with_the_tool_point_of_the_model(fitted: Fitted, slip: float) -> None:
    """The registration takes up a part of a shift of the tool point, on arms of 2 m less than half."""
    model, made = fitted
    found = model.verify(later(made, 4, tool=slip), tolerance="0.1 mm")
    assert not found.passed
    assert 0.3e3 * slip < found.record.after.rms_mm < 1.1e3 * slip
    assert found.record.beyond >= 15


@pytest.mark.first(1)
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_one_zero_of_an_accurate_machine_is_no_other_machine(accurate: Fitted, seed: int) -> None:
    """The nominal geometry of an accurate machine is hardly worse than its model after a small change."""
    model, made = accurate
    for moved in (2e-4, 5e-4):
        found = model.verify(later(made, seed, joint=1, moved=moved)).record
        assert found.verdict == "drifted"
        assert found.changes[0].name == "zero of J2"
        assert abs(found.changes[0].value - moved) < 4 * found.changes[0].stderr


def test_another_machine_is_told_from_one_that_drifted(fitted: Fitted) -> None:
    other = robot(25, seed=9, noise=NOISE)[1]
    assert fitted[0].verify(later(other, 5)).record.verdict == "another machine"


def test_a_model_whose_noise_is_known_for_sure_is_judged_as_well(fitted: Fitted) -> None:
    """Also one written before the degrees of freedom of its noise were kept."""
    known = gp.Model(replace(fitted[0].saved, freedom=np.inf))
    assert known.verify(later(fitted[1], 5)).holds
    drifted = known.verify(later(fitted[1], 5, joint=1, moved=1e-4)).record
    assert drifted.verdict == "drifted"
    assert drifted.chance < 1e-6
    assert all(pose.chance is not None for pose in drifted.poses)


def test_the_zero_that_the_registration_stands_for_is_said_to_be_unseen(fitted: Fitted) -> None:
    model, made = fitted
    found = model.verify(later(made, 6, joint=0, moved=1e-3))
    assert found.holds
    assert found.record.visible[0].size is None
    assert 0.0 < found.record.visible[1].size < 1e-4


def test_one_wrong_reading_is_an_outlier_and_no_change_but_beyond_the_tolerance(fitted: Fitted) -> None:
    model, made = fitted
    dataset = later(made, 7)
    position = dataset.position.copy()
    position[4, 1] += 2e-3
    found = model.verify(replace(dataset, position=position), tolerance="0.5 mm")
    assert (found.holds, found.passed) == (True, False)
    assert found.record.data.outliers == (5,)
    assert [p.row for p in found.record.beyond_tolerance] == [5]


@pytest.mark.long
@pytest.mark.parametrize("rows", [(4, 0), (0, 10)])
def test_a_wrong_reading_that_is_not_left_out_is_no_change_either(fitted: Fitted, rows: tuple[int, int]) -> None:
    """An effect at one row, such as a warm-up shorter than a row, would explain it."""
    model, made = fitted
    for seed in range(20, 28):
        dataset = later(made, seed)
        position = dataset.position.copy()
        position[rows, (1, 0)] += (2e-3, 1.5e-4)
        found = model.verify(replace(dataset, position=position)).record
        assert (found.verdict, found.changes) == ("holds", ())


def test_repeats_of_a_pose_are_one_measurement(fitted: Fitted) -> None:
    """Ten readings of each of six poses are no sixty poses."""
    model, made = fitted
    six = later(made, 8, 6)
    rows = np.repeat(np.arange(6), 10)
    noisy = six.position[rows] + np.random.default_rng(1).normal(0.0, 1e-6, (60, 3))
    found = model.verify(replace(six.subset(rows), position=noisy, row=np.arange(1, 61)))
    assert found.record.degrees == 12
    assert found.holds


@pytest.mark.long
def test_errors_of_the_instrument_are_used_where_the_readings_have_them() -> None:
    arm, made = robot(80, seed=4, noise=NOISE)
    off = 2e-4 * np.linalg.norm(made.dataset.position, axis=1, keepdims=True) * made.dataset.position
    data = replace(made.dataset, position=made.dataset.position + off)
    wave = [f"instrument:T{a}:instrument_{a}*instrument_range" for a in "xyz"]
    model = gp.calibrate(arm, data, wave, holdout=0.0).model
    first = later(made, 3)
    again = first.position + 2e-4 * np.linalg.norm(first.position, axis=1, keepdims=True) * first.position
    assert model.verify(first).record.instrument is False
    assert model.verify(replace(first, position=again)).record.instrument is True


def write(dataset: Dataset, arm: gp.Mechanism, path: Path) -> Path:
    path.write_text(table_text(frame_of(dataset, arm)))
    return path


@pytest.mark.long
def test_the_command_says_it_by_its_status_and_leaves_a_page_and_a_certificate(fitted: Fitted, tmp_path: Path) -> None:
    model, made = fitted
    model.save(tmp_path / "model.json")
    for name, dataset, status in (("same", later(made, 1), 0), ("moved", later(made, 2, joint=1, moved=1e-4), 3)):
        table, out = write(dataset, model.mechanism, tmp_path / f"{name}.csv"), tmp_path / name
        result = run("verify", tmp_path / "model.json", table, "--tolerance", "0.3mm", "--out", out)
        assert result.exit_code == status, result.stderr
        assert {p.name for p in out.iterdir()} == {"verify.html", "verify.csv", "verify.json"}
        assert ("zero of J2 moved by" in (out / "verify.html").read_text()) == bool(status)
        assert run("certificate", out, "--machine", "Cell 4").exit_code == 0
        page = (out / "certificate.html").read_text()
        assert "Verification certificate: Cell 4" in page
        assert "measured after the model was fitted" in page


@pytest.mark.long
def test_what_cannot_be_judged_is_refused_in_a_line(fitted: Fitted, tmp_path: Path) -> None:
    model, made = fitted
    model.save(tmp_path / "model.json")
    arm = model.mechanism
    few = write(later(made, 1, 3), arm, tmp_path / "few.csv")
    good = write(later(made, 1), arm, tmp_path / "good.csv")
    one = later(made, 1, 1).subset(np.zeros(30, dtype=int))
    copied = write(replace(one, row=np.arange(1, 31)), arm, tmp_path / "copied.csv")
    noisy = one.position + np.random.default_rng(0).normal(0.0, NOISE, one.position.shape)
    same = write(replace(one, position=noisy, row=np.arange(1, 31)), arm, tmp_path / "same.csv")
    (tmp_path / "bare.csv").write_text(good.read_text().replace("x [mm]", "p [mm]").replace("y [mm]", "q [mm]")
                                       .replace("z [mm]", "r [mm]"))  # fmt: skip
    for table, more, said in (
        (few, (), "expected at least 4 poses"), (same, (), "1 different poses are too few"),
        (copied, (), "1 poses with x, y and z"),
        (tmp_path / "bare.csv", (), "nothing measured"),
        (good, ("--tolerance", "0.1"), "--tolerance"), (tmp_path / "none.csv", (), "cannot be read"),
    ):  # fmt: skip
        assert said in one_line(run("verify", tmp_path / "model.json", table, *more), 2)
    with pytest.raises(gp.InputError, match="tolerance"):
        gp.verify(model, good, tolerance=0.1)  # type: ignore[arg-type]


def test_the_table_of_the_fit_itself_verifies_nothing(fitted: Fitted, tmp_path: Path) -> None:
    arm, made = robot(40, seed=5)
    table = write(made.dataset, arm, tmp_path / "t.csv")
    model = gp.calibrate("irb6400r", table, holdout=0.0).model
    with pytest.raises(gp.InputError, match="is the table the model was fitted to"):
        model.verify(table)
    with pytest.raises(gp.InputError, match="is the table the model was fitted to"):
        model.verify(pd.read_csv(table))


@pytest.mark.long
def test_targets_that_were_compensated_are_judged_where_the_machine_went(fitted: Fitted, tmp_path: Path) -> None:
    """The table of `compensate` with what was measured: its corrected values are the joint values."""
    model, made = fitted
    arm = model.mechanism
    targets = unmeasured([j.name for j in arm.joints], 0.6 * random_poses(arm, 20, np.random.default_rng(8)))
    sent = model.compensate(frame_of(targets, arm)[[f"J{i} [deg]" for i in range(1, 7)]])
    went = np.radians(sent[[f"corrected_J{i} [deg]" for i in range(1, 7)]].to_numpy(dtype=float))
    kept = np.isfinite(went).all(axis=1)
    poses = prepare(arm, unmeasured([j.name for j in arm.joints], went[kept]))
    tip = observe(made.model, poses, made.theta, made.placement).tip[:, :3, 3]
    points = np.full((20, 3), np.nan)
    points[kept] = 1e3 * (tip + np.random.default_rng(2).normal(0.0, NOISE, tip.shape))
    measured = sent.assign(**{f"{a} [mm]": points[:, i] for i, a in enumerate("xyz")})
    found = model.verify(measured)
    assert found.holds
    assert len(found.record.poses) == kept.sum()
    assert found.record.missed.rms_mm < 0.1
    assert sent["correction [mm]"].median() > 0.5


@pytest.mark.long
def test_of_many_rows_as_many_as_a_check_fits_are_judged_and_it_says_so(fitted: Fitted) -> None:
    model, made = fitted
    found = model.verify(later(made, 9, 5000))
    assert (found.holds, len(found.record.poses), found.record.rows) == (True, 2000, 5000)
    assert "judged on: 2000 of 5000 rows" in " ".join(found.summary().split())


@pytest.mark.long
@pytest.mark.parametrize(("factor", "said"), [(1e3, "1000 times too large"), (1e-3, "1000 times too small")])
def test_columns_in_another_unit_are_refused_and_no_verdict(fitted: Fitted, factor: float, said: str) -> None:
    """A scale of the instrument that is a thousandth would explain them."""
    data = later(fitted[1], 1)
    with pytest.raises(gp.InputError, match=said):
        fitted[0].verify(replace(data, position=factor * data.position))
