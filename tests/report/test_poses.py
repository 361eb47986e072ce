"""The poses of a report: listed, as a table, and in the picture that turns."""

import io
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from report_runs import REPORTS, calibrated, discovered

from gpmodel.report import explore, poses
from gpmodel.report.schema_poses import PlotRecord


def test_poses_are_listed_worst_first_and_are_those_of_the_ladder() -> None:
    for report in (discovered(), calibrated(), discovered("nothing")):
        listed = poses.pose_errors(report)
        assert len(listed) == report.data.poses
        after = [p.after for p in listed]
        assert after == sorted(after, reverse=True)
        names = report.before_and_after()
        for step, errors in zip(names, ([p.before for p in listed], after), strict=True):
            rung = report.step(step)
            assert rung is not None
            assert max(errors) == pytest.approx(max(rung.train.max_mm, rung.heldout.max_mm), rel=1e-5)
        held = np.array([p.after for p in listed if p.heldout])
        assert np.sqrt(np.mean(held**2)) == pytest.approx(report.step(names[1]).heldout.rms_mm, rel=1e-5)


def test_poses_csv_has_a_row_a_pose_and_its_components() -> None:
    report = discovered()
    frame = pd.read_csv(io.StringIO(poses.csv(report)))
    assert list(frame["row"]) == list(report.plots.rows)
    assert (frame["set"] == "held out").sum() == report.data.heldout
    for name in ("before", "after"):
        length = np.linalg.norm(frame[[f"{name}_{a} [mm]" for a in "xyz"]], axis=1)
        np.testing.assert_allclose(length, frame[f"{name} [mm]"], atol=2e-4)  # rounded to 1e-4


def test_without_residuals_poses_csv_has_its_header_alone() -> None:
    text = poses.csv(replace(discovered(), plots=PlotRecord()))
    assert text == "row,set,outlier,before [mm],after [mm]\n"


def row_of(pose: poses.PoseError) -> int:
    return pose.row


@pytest.mark.parametrize("case", ["gear", "nothing", "calibrated"])
def test_explore_has_every_pose_its_row_and_both_residuals(case: str) -> None:
    report = REPORTS[case]()
    text = explore.html(report)
    assert len(text) < 6e6
    figure, magnification = explore.figure_of(report)
    before, after, dots, mark, arm = figure["data"]
    assert dots["customdata"] == list(report.plots.rows)
    assert all(f"row {row}" in said for row, said in zip(report.plots.rows, dots["text"], strict=True))
    for trace, name in ((before, report.before_and_after()[0]), (after, "final")):
        ends = np.array([trace[a] for a in "xyz"], dtype=float).reshape(3, -1, 3)
        moved = (ends[:, :, 1] - ends[:, :, 0]).T / magnification
        np.testing.assert_allclose(moved, np.array(report.plots.residual_mm[name]), atol=2e-3 / magnification)
    assert arm["text"] == list(report.plots.slots)
    assert mark["x"] == []
    expected = [p.after for p in sorted(poses.pose_errors(report), key=row_of)]
    np.testing.assert_allclose(dots["marker"]["color"], expected, atol=1e-3)
    assert [int(r) for r in re.findall(r'data-row="(\d+)"', text)] == [p.row for p in poses.pose_errors(report)[:30]]
