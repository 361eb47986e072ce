"""Where orientations were measured, their error stands in mrad wherever that of the point stands in mm."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import robot

import gpmodel as gp
from gpmodel.model.error_model import observe, prepare
from gpmodel.numerics.se3 import exp, rotation_vector
from gpmodel.report.poses import csv
from gpmodel.report.verdict import behind
from gpmodel.table.write import frame_of

NOISE = 2e-4
"""rad, each component."""


def measured(poses: int, seed: int, rotations: bool = True) -> pd.DataFrame:
    mechanism, made = robot(poses, seed)
    if not rotations:
        return frame_of(made.dataset, mechanism)
    tip = observe(made.model, prepare(mechanism, made.dataset), made.theta, made.placement).tip[:, :3, :3]
    noise = np.random.default_rng(seed).normal(0.0, NOISE, (poses, 3))
    turned = rotation_vector(exp(np.hstack([np.zeros((poses, 3)), noise]))[:, :3, :3] @ tip)
    frame = frame_of(made.dataset, mechanism).astype(float)
    return frame.assign(**{f"r{a} [deg]": np.degrees(turned[:, k]) for k, a in enumerate("xyz")})


@pytest.fixture(scope="module")
def fit() -> "gp.CalibrateResult":
    return gp.calibrate("irb6400r", measured(40, 1), holdout=0.3)


def test_the_report_has_the_error_of_orientation_before_and_after(fit: "gp.CalibrateResult") -> None:
    kinds = {kind.name: kind for kind in fit.record.readings}
    found = kinds["orientation"]
    assert found.unit == "mrad"
    assert found.before is not None
    assert found.after is not None
    assert found.before > 2.0 * found.after
    assert 0.8e3 * NOISE < found.after / np.sqrt(3.0) < 1.5e3 * NOISE
    assert f"{found.before:.3g} → {found.after:.3g} mrad" in fit.summary()
    assert f"{found.before:.3g} → {found.after:.3g} mrad RMS on held-out poses" in behind(fit.record)


def test_it_is_told_as_a_length_at_the_tool_point(fit: "gp.CalibrateResult") -> None:
    found = next(kind for kind in fit.record.readings if kind.unit == "mrad")
    tool = {p.name: p.value for p in fit.record.placement}
    lever = np.linalg.norm([tool[f"tool {axis}"] for axis in "xyz"])
    assert found.after is not None
    said = f"{found.after * lever:.3f} mm at {1e3 * lever:.0f} mm from the flange"
    assert said in behind(fit.record)


def test_the_ladder_has_it_step_by_step(fit: "gp.CalibrateResult") -> None:
    found = next(kind for kind in fit.record.readings if kind.unit == "mrad")
    first, last = (fit.record.turn_mrad(fit.record.ladder[k]) for k in (0, -1))
    assert (first, last) == pytest.approx((found.before, found.after), rel=1e-6)
    lines = fit.summary().splitlines()
    head = next(line for line in lines if line.endswith("mrad"))
    below = [line.split()[-1] for line in lines[lines.index(head) + 1 :] if line.strip() and line[-1].isdigit()]
    assert [float(text) for text in below[:2]] == pytest.approx([found.before, found.after], rel=1e-2)
    assert max(map(len, lines)) <= 80


def test_poses_csv_has_it_pose_by_pose(fit: "gp.CalibrateResult", tmp_path: Path) -> None:
    (tmp_path / "poses.csv").write_text(csv(fit.record))
    poses = pd.read_csv(tmp_path / "poses.csv")
    held = poses[poses["set"] == "held out"]
    found = next(kind for kind in fit.record.readings if kind.unit == "mrad")
    assert np.sqrt(np.mean(held["after [mrad]"] ** 2)) == pytest.approx(found.after, rel=1e-3)


def test_the_verdict_compares_orientations_of_the_steps_whose_positions_it_compares(fit: "gp.CalibrateResult") -> None:
    named = gp.calibrate("irb6400r", measured(40, 1), ["joint_compliance J2"], holdout=0.3).record
    for record, before in ((fit.record, "registration only"), (named, "standard model")):
        assert f": {before} " in record.verdict
        assert f"Orientation: {before} " in behind(record)
    standard = named.turn_mrad(named.ladder[-2])
    assert standard is not None
    assert f"standard model {standard:.3g} → " in behind(named)


@pytest.mark.long
def test_certificate_and_verification_state_it(fit: "gp.CalibrateResult") -> None:
    later = fit.model.verify(measured(40, 1).iloc[:30].assign(**{"x [mm]": lambda d: d["x [mm]"] + 1e-3}))
    there = f"at {1e3 * fit.model.saved.lever:.0f} mm from the flange"
    for text in (gp.certificate(fit).summary(), later.summary(), gp.certificate(later).summary()):
        said = " ".join(text.split())
        assert "mrad" in said
        assert there in said


@pytest.mark.long
def test_it_stands_nowhere_without_orientations() -> None:
    plain = gp.calibrate("irb6400r", measured(40, 1, rotations=False))
    assert not plain.record.readings
    assert "[mrad]" not in csv(plain.record)
