"""A long table: the verdict rests on some of its rows, the tolerance on all."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli_cases import robot

import gpmodel as gp
from gpmodel.api import verification
from gpmodel.mechanism.workspace import random_poses
from gpmodel.model.error_model import observe, prepare
from gpmodel.report.verification import read_verification
from gpmodel.table.dataset import Dataset, unmeasured


@pytest.fixture
def later(monkeypatch: pytest.MonkeyPatch) -> tuple[gp.Model, Dataset]:
    """A model, and 80 later poses of which every second is judged; two of the others are 5 mm off."""
    monkeypatch.setattr(verification, "evenly", lambda count: np.arange(0, count, 2))
    arm, made = robot(60, seed=3, noise=2e-5)
    rng = np.random.default_rng(9)
    poses = unmeasured([j.name for j in arm.joints], random_poses(arm, 80, rng))
    points = observe(made.model, prepare(arm, poses), made.theta, made.placement).tip[:, :3, 3]
    points = points + rng.normal(0.0, 2e-5, points.shape)
    points[[31, 33], 0] += 5e-3
    return gp.calibrate(arm, made.dataset, holdout=0.0).model, replace(poses, position=points, source="later.csv")


def test_a_tolerance_is_of_all_rows(later: tuple[gp.Model, Dataset], tmp_path: Path) -> None:
    model, data = later
    found = model.verify(data, tolerance="1 mm")
    assert (found.holds, found.passed, len(found.record.poses)) == (True, False, 40)
    assert "2 of 80 poses are beyond 1 mm, the worst, row 3" in found.verdict
    assert found.record.worst[0] in (32, 34)
    found.report(tmp_path / "out")
    assert read_verification(tmp_path / "out") == found.record
    gp.certificate(tmp_path / "out", tolerance="4 mm").report(tmp_path / "paper")
    assert "fail: 2 of 80 poses are beyond 4 mm" in (tmp_path / "paper" / "certificate.html").read_text()


def test_all_rows_within_a_tolerance_pass(later: tuple[gp.Model, Dataset]) -> None:
    model, data = later
    found = model.verify(data, tolerance="9 mm")
    assert found.passed
    assert "Every pose is within 9 mm, the worst has 5.0" in found.verdict
