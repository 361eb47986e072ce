"""A check that goes on pose by pose: it ends soon, names what changed, and proposes poses that tell."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, run
from verify_cases import Fitted, fitted_robot, placed_anew, read_later

import gpmodel as gp
from gpmodel.api.verify import NextCheck
from gpmodel.application.next_check import FALSE_ALARM, FIRST, significance
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


def checked(fitted: Fitted, joint: int = 0, moved: float = 0.0) -> tuple[NextCheck, np.ndarray]:
    """A check to its end, and the poses it took."""
    model, made = fitted
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


def test_a_machine_that_did_not_change_is_good_after_a_few_different_poses(fitted: Fitted) -> None:
    found, q = checked(fitted)
    assert found.holds
    assert FIRST <= found.poses == len(q) <= 12
    assert len(np.unique(q.round(6), axis=0)) == len(q)
    assert "would have been seen" in found.summary()


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_a_zero_that_moved_is_named_within_twelve_poses(fitted: Fitted, joint: int) -> None:
    found, q = checked(fitted, joint, 5e-4)
    assert found.holds is False
    assert found.judged is not None
    change = found.judged.record.changes[0]
    assert change.name == f"zero of J{joint + 1}"
    assert abs(change.value - 5e-4) < 3.0 * change.stderr
    assert len(q) <= 12


def test_proposed_poses_show_more_than_poses_of_the_fit_at_random(fitted: Fitted) -> None:
    model, made = fitted

    def worst(q: np.ndarray) -> float:
        judged = gp.verify_next(model, measured(made, q, 0, 0.0)).judged
        assert judged is not None
        return max(zero.size or 1.0 for zero in judged.record.visible[1:])

    _, q = checked(fitted)
    rng = np.random.default_rng(1)
    random = [worst(made.dataset.q[rng.choice(len(made.dataset), len(q), replace=False)]) for _ in range(5)]
    assert worst(q) < np.median(random)


def test_the_command_says_the_next_pose_until_it_is_decided(fitted: Fitted, tmp_path: Path) -> None:
    model, made = fitted
    model.save(tmp_path / "model.json")
    first = run("verify", tmp_path / "model.json", "--next")
    assert first.exit_code == 4
    assert f"0 of the {FIRST}" in first.output
    _, q = checked(fitted)
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
