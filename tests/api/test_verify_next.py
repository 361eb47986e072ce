"""Test that `verify_next` ends after few poses, names the change, and proposes informative poses."""

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, run
from instances import some
from verify_cases import Fitted, fitted_robot, placed_anew, read_later

import gpmodel as gp
from gpmodel.api.verify import NextCheck
from gpmodel.application.next_check import FALSE_ALARM, FIRST, level, significance
from gpmodel.mechanism.branches import random_poses
from gpmodel.planning.simulate import Simulation
from gpmodel.table.cells import frame_of, table_text
from gpmodel.table.dataset import Dataset


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    return fitted_robot()


def measured(made: Simulation, q: np.ndarray, joint: int, moved: float) -> Dataset:
    """Poses (N, n) measured later from another place of the instrument; more rows keep what the first ones have."""
    rng = np.random.default_rng(7)
    return read_later(made, q, placed_anew(made, rng), rng, joint, moved)


def errors(model: gp.Model, made: Simulation, joint: int, moved: float) -> float:
    """RMS error, mm, at 60 other poses without noise, less a registration."""
    rng = np.random.default_rng(3)
    q = random_poses(made.model.mechanism, 60, rng)
    return (
        model.verify(read_later(made, q, placed_anew(made, rng), rng, joint, moved, noise=0.0)).record.after.rms_mm
        or 0.0
    )


@cache
def checked(joint: int = 0, moved: float = 0.0) -> tuple[NextCheck, np.ndarray]:
    """A check to its end, and the poses it took."""
    model, made = fitted_robot()
    found, q = gp.verify_next(model), np.zeros((0, len(made.model.mechanism.joints)))
    while found.next is not None:
        q = np.vstack([q, np.radians(found.next.to_numpy(dtype=float))])
        assert len(q) <= 20
        found = gp.verify_next(model, measured(made, q, joint, moved))
    return found, q


def test_all_looks_together_spend_the_false_alarm() -> None:
    spent = sum(2.0 * significance(n) for n in range(FIRST, 100_000))
    assert spent == pytest.approx(FALSE_ALARM, rel=1e-4)
    assert spent < FALSE_ALARM


@pytest.mark.parametrize(("moved", "first"), [(5e-4, True), (0.0, False)])
def test_a_change_that_one_test_reports_is_tested_at_the_level_of_that_test(
    fitted: Fitted, moved: float, first: bool
) -> None:
    model, made = fitted
    later = measured(made, model.saved.measured.dataset.q[:10], 2, moved)
    assert level(model.saved, later) == significance(FIRST if first else 10)


def test_a_machine_that_did_not_change_is_good_after_a_few_different_poses() -> None:
    found, q = checked()
    assert found.holds
    assert FIRST <= found.poses == len(q) <= 12
    assert len(np.unique(q.round(6), axis=0)) == len(q)
    assert "would have been detected" in found.summary()
    assert found.repaired is None


@pytest.mark.parametrize("joint", some([1, 2, 3], 1, 3))
def test_a_zero_that_moved_is_named_within_twelve_poses(joint: int) -> None:
    found, q = checked(joint, 5e-4)
    assert found.holds is False
    assert found.judged is not None
    change = found.judged.record.changes[0]
    assert change.name == f"zero of J{joint + 1}"
    assert abs(change.value - 5e-4) < 3.0 * change.stderr
    assert len(q) <= 12


@pytest.mark.parametrize("joint", some([1, 3], 1))
def test_the_repaired_model_predicts_as_the_old_one_did_before_the_change(
    fitted: Fitted, joint: int, tmp_path: Path
) -> None:
    model, made = fitted
    found, q = checked(joint, 5e-4)
    assert found.repaired is not None
    (number,) = found.repaired.found.numbers
    assert number.name == f"zero of J{joint + 1}"
    (before, known), (after, deviation) = number.before, number.after
    assert abs(after - before - 5e-4) < 3.0 * np.hypot(known, deviation)
    found.repaired.model.save(tmp_path / "repaired.json")
    again = gp.load_model(tmp_path / "repaired.json")
    before_mm, after_mm = (errors(m, made, joint, 5e-4) for m in (model, again))
    assert after_mm < min(2.5e3 * found.repaired.found.expected, 0.3 * before_mm)
    later = measured(made, q, joint, 5e-4)
    assert not set(later.position.ravel()) - set(again.saved.measured.dataset.position.ravel())
    assert gp.verify_next(again).next is not None


@pytest.mark.long
def test_poses_that_a_repaired_model_lacks_make_it_as_good_as_before(fitted: Fitted) -> None:
    model, made = fitted
    q, slip = model.saved.measured.dataset.q[:6], 3e-4
    rng = np.random.default_rng(7)
    placement = placed_anew(made, rng, slip)

    def found(q: np.ndarray) -> NextCheck:
        return gp.verify_next(model, read_later(made, q, placement, np.random.default_rng(8)))

    first = found(q).repaired
    assert first is not None
    assert {n.name for n in first.found.numbers} == {f"tool point {axis}" for axis in "xyz"}
    assert first.found.expected > 1.2 * first.found.before
    assert first.more is not None
    assert f"Measure {len(first.more)} more poses" in first.summary()
    last = found(np.vstack([q, np.radians(first.more.to_numpy(dtype=float))])).repaired
    assert last is not None
    assert last.found.expected < 1.21 * last.found.before
    assert len(last.more) <= 1
    assert "measure" not in last.summary() or len(last.more)
    moved = last.to_dataframe().set_index("name")
    for axis, true in zip("xyz", (slip, 0.0, 0.0), strict=True):
        row = moved.loc[f"tool point {axis}"]
        assert abs(row["after"] - row["before"] - true) < 4.0 * np.hypot(row["stderr before"], row["stderr after"])


@pytest.mark.long
def test_the_expected_error_of_a_repaired_model_is_the_one_it_makes(fitted: Fitted) -> None:
    model, made = fitted
    squares = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        later = read_later(
            made, model.saved.measured.dataset.q[10 * seed : 10 * seed + 10], placed_anew(made, rng), rng, 2, 5e-4
        )
        repair = gp.verify_next(model, later).repaired
        assert repair is not None
        squares.append((errors(repair.model, made, 2, 5e-4) / (1e3 * repair.found.expected)) ** 2)
    assert 0.5 < np.mean(squares) < 2.0


@pytest.mark.long
def test_a_model_with_an_effect_of_its_session_is_repaired_too(fitted: Fitted, tmp_path: Path) -> None:
    _, made = fitted
    arm, rng = made.model.mechanism, np.random.default_rng(5)
    model = gp.calibrate(arm, made.dataset, ["base_compliance", "J1.moving:Rz:row/60"], holdout=0.0).model
    later = read_later(made, made.dataset.q[20:32], placed_anew(made, rng), rng, 2, 5e-4)
    repair = gp.verify_next(model, later).repaired
    assert repair is not None
    assert [n.name for n in repair.found.numbers] == ["zero of J3"]
    repair.model.save(tmp_path / "now.json")
    again = gp.load_model(tmp_path / "now.json")
    assert errors(again, made, 2, 5e-4) < min(2.5e3 * repair.found.expected, 0.3 * errors(model, made, 2, 5e-4))


@pytest.mark.long
def test_proposed_poses_show_more_than_poses_of_the_fit_at_random(fitted: Fitted) -> None:
    model, made = fitted

    def worst(q: np.ndarray) -> float:
        judged = gp.verify_next(model, measured(made, q, 0, 0.0)).judged
        assert judged is not None
        return max(zero.size or 1.0 for zero in judged.record.visible[1:])

    _, q = checked()
    rng = np.random.default_rng(1)
    random = [worst(made.dataset.q[rng.choice(len(made.dataset), len(q), replace=False)]) for _ in range(5)]
    assert worst(q) < np.median(random)


def test_the_command_says_the_next_pose_until_it_is_decided(fitted: Fitted, tmp_path: Path) -> None:
    model, made = fitted
    model.save(tmp_path / "model.json")
    first = run("verify", tmp_path / "model.json", "--next")
    assert first.exit_code == 4
    assert f"has 0 different poses. A check needs at least {FIRST}" in first.output
    _, q = checked()
    table = tmp_path / "later.csv"
    table.write_text(table_text(frame_of(measured(made, q[:-1], 0, 0.0), made.model.mechanism)), encoding="utf-8")
    open_still = run("verify", tmp_path / "model.json", table, "--next")
    assert open_still.exit_code == 4
    said = pd.Series(open_still.output.strip().splitlines()[-1].split(","), dtype=float)
    np.testing.assert_allclose(np.radians(said), q[-1], atol=1e-4)
    table.write_text(table_text(frame_of(measured(made, q, 0, 0.0), made.model.mechanism)), encoding="utf-8")
    assert run("verify", tmp_path / "model.json", table, "--next", "--out", tmp_path / "out").exit_code == 0
    assert (tmp_path / "out" / "verify.html").is_file()
    assert "expected a table" in one_line(run("verify", tmp_path / "model.json"), 2)


def test_the_command_leaves_the_repaired_model_where_it_is_told_to(fitted: Fitted, tmp_path: Path) -> None:
    model, made = fitted
    _, q = checked(1, 5e-4)
    judged, table = tmp_path / "model.json", tmp_path / "later.csv"
    model.save(judged)
    table.write_text(table_text(frame_of(measured(made, q, 1, 5e-4), made.model.mechanism)), encoding="utf-8")
    command = ("verify", judged, table, "--next", "--out")
    in_folder = run(*command, tmp_path / "out")
    assert in_folder.exit_code == 3
    assert "zero of J2" in in_folder.output
    assert (tmp_path / "out" / "verify.html").is_file()
    assert run(*command, tmp_path / "now.json").exit_code == 3
    assert gp.load_model(tmp_path / "now.json") == gp.load_model(tmp_path / "out" / "repaired.json")
    before = judged.read_bytes()
    assert "expected another file" in one_line(run(*command, judged), 2)
    assert judged.read_bytes() == before
    assert "expected a folder" in one_line(run("verify", judged, table, "--out", tmp_path / "now.json"), 2)
