"""Test that each picture shows the numbers of the report of a small search."""

import dataclasses
import io
import re
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from cli_cases import robot
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from report_runs import REPORTS, calibrated, discovered

import gpmodel as gp
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.report import explore, figures, poses
from gpmodel.report.page import pictures
from gpmodel.report.picture import AFTER, BEFORE, NULL, PAPER, broken
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import PlotRecord, SideErrors
from gpmodel.wording import millimetres

SOME = {"ladder", "error_histogram", "cumulative", "arrows_above", "rows"}


def drawn(report: Report, name: str) -> Any:
    picture = next(p for p in pictures(report) if p.name == name)
    figure = Figure(figsize=(picture.width, picture.height))
    picture.draw(figure)
    return figure


@pytest.mark.long
def test_every_picture_the_numbers_allow_is_a_png_of_its_size(tmp_path: Path) -> None:
    report = discovered()
    drawings = figures.drawn(pictures(report), tmp_path)
    sizes = {p.name: (p.width, p.height) for p in pictures(report)}
    assert set(drawings) == set(sizes) >= {*SOME, "inputs_1", "search", "shape_1", "parameters_angles"}
    for name, size in sizes.items():
        content = (tmp_path / "figures" / f"{name}.png").read_bytes()
        assert content[:8] == b"\x89PNG\r\n\x1a\n"
        expected = [figures.DOTS_PER_INCH * s for s in size]
        assert np.allclose(struct.unpack(">II", content[16:24]), expected, atol=1.0)


@pytest.mark.long
def test_no_text_of_a_picture_is_cut_at_its_edge() -> None:
    for picture in pictures(discovered()):
        drawing = figures.figure(picture)
        figures.svg_of(drawing)
        box = drawing.get_tightbbox()
        assert min(box.x0, box.y0) > -0.02, picture.name
        assert max(box.x1 - picture.width, box.y1 - picture.height) < 0.02, picture.name


@pytest.mark.parametrize("case", REPORTS)
def test_each_kind_of_result_has_its_pictures(case: str) -> None:
    assert {p.name for p in pictures(REPORTS[case]())} >= SOME


@pytest.mark.long
def test_the_same_report_gives_the_same_files(tmp_path: Path) -> None:
    report = calibrated(0.0)
    assert figures.drawn(pictures(report), tmp_path / "a") == figures.drawn(pictures(report), tmp_path / "b")
    first, second = ((tmp_path / k / "figures" / "ladder.png").read_bytes() for k in ("a", "b"))
    assert first == second


def test_ladder_puts_filled_dots_at_held_out_and_hollow_ones_at_training_errors() -> None:
    report = discovered()
    dots = [line for line in drawn(report, "ladder").axes[0].lines if line.get_marker() == "o"]
    filled = [float(np.ravel(d.get_xdata())[0]) for d in dots if d.get_markerfacecolor() != PAPER]
    hollow = [float(np.ravel(d.get_xdata())[0]) for d in dots if d.get_markerfacecolor() == PAPER]
    assert filled == [r.heldout.rms_mm for r in report.ladder]
    assert hollow == [r.train.rms_mm for r in report.ladder]


def test_error_histogram_shares_bins_and_counts_every_held_out_pose() -> None:
    report = discovered()
    before, after = drawn(report, "error_histogram").axes
    assert [p.get_x() for p in before.patches] == [p.get_x() for p in after.patches]
    assert [to_hex(a.patches[0].get_facecolor()) for a in (before, after)] == [BEFORE, AFTER]
    for axes in (before, after):
        assert sum(p.get_height() for p in axes.patches) == report.data.heldout


def test_error_beyond_the_axis_is_said_not_dropped() -> None:
    report = discovered("nothing")
    far = SideErrors((), tuple([0.03 + 0.001 * k for k in range(99)] + [40.0]))
    plots = dataclasses.replace(report.plots, rows=(), heldout_mask=(True,) * 100, error_mm={"standard": far})
    axes = drawn(dataclasses.replace(report, plots=plots), "error_histogram").axes[0]
    assert axes.get_xlim()[1] < 1.0
    assert any("1 beyond the axis" in text.get_text() for text in axes.texts)


def test_cumulative_ends_at_all_poses_and_the_largest_error() -> None:
    report = discovered()
    curves = [line for line in drawn(report, "cumulative").axes[0].lines if len(line.get_xdata()) > 2]
    for curve, rung in zip(curves, report.ladder, strict=True):
        assert curve.get_ydata()[-1] == 100.0
        assert curve.get_xdata()[-1] == pytest.approx(rung.heldout.max_mm, rel=1e-5)


@pytest.mark.long
def test_every_dot_says_its_row_and_leads_to_it() -> None:
    report = discovered()
    for name, count in (("rows", 6 * report.data.poses), ("shape_1", len(report.plots.shapes[0].x))):
        svg = figures.drawn(pictures(report))[name]
        rows = re.findall(r'<a href="explore.html#row=(\d+)" tabindex="-1"><title>row (\d+)</title>', svg)
        assert len(rows) == count
        assert all(a == b for a, b in rows)
        assert {int(a) for a, _ in rows} <= set(report.plots.rows)


def test_arrows_start_at_the_tip_and_show_the_residual() -> None:
    report = discovered()
    quivers = [c for c in drawn(report, "arrows_above").axes[0].collections if hasattr(c, "U")]
    for quiver, step in zip(quivers, ("standard", "final"), strict=True):
        residual = np.array(report.plots.residual_mm[step])
        assert np.allclose(quiver.get_offsets(), np.array(report.plots.points_mm)[:, :2])
        assert np.allclose(np.column_stack([quiver.U, quiver.V]), residual[:, :2])


def test_every_effect_has_arrows_of_what_it_does_to_the_tool_from_above_and_from_the_side() -> None:
    for report in (calibrated(), discovered("windup")):
        for number, effect in enumerate(report.effects, 1):
            moved = effect.moved
            assert moved is not None
            points, moves = np.array(moved.points_mm), np.array(moved.moves_mm)
            assert 0.5 * effect.workspace_max_mm < np.linalg.norm(moves, axis=1).max() <= effect.workspace_max_mm + 1e-4
            for axes, side in zip(drawn(report, f"moved_{number}").axes, ([0, 1], [0, 2]), strict=True):
                quiver = next(c for c in axes.collections if hasattr(c, "U"))
                assert np.allclose(quiver.get_offsets(), points[:, side])
                assert np.allclose(np.column_stack([quiver.U, quiver.V]), moves[:, side])


def test_poses_without_a_measurement_are_left_out_of_the_arrows_and_rows() -> None:
    report = discovered()
    final = list(report.plots.residual_mm["final"])
    final[3] = (None, None, None)
    plots = dataclasses.replace(report.plots, residual_mm=report.plots.residual_mm | {"final": tuple(final)})
    holes = dataclasses.replace(report, plots=plots)
    quiver = next(c for c in drawn(holes, "arrows_above").axes[0].collections if hasattr(c, "U"))
    assert len(quiver.U) == report.data.poses - 1
    assert drawn(holes, "rows").axes


def test_input_bars_show_counts_beside_the_null_in_its_own_colour() -> None:
    counted = Histogram(
        ("J1", "J4"), {"linear": (1, 6), "tree": (0, 2)}, {"linear": (3, 1)}, {}, {"linear": 8}, {"linear": 8},
        (1.0, 0.001), (1.0, 0.004), 0.05,
    )  # fmt: skip
    report = dataclasses.replace(discovered(), histograms=(counted,))
    bars = [p for p in drawn(report, "inputs_1").axes[0].patches if p.get_height() < 0.5]
    assert [p.get_width() for p in bars if to_hex(p.get_facecolor()) == NULL] == [3, 1]
    assert [p.get_width() for p in bars if to_hex(p.get_facecolor()) == AFTER] == [6]
    assert [p.get_width() for p in bars if to_hex(p.get_edgecolor()) == AFTER] == [6, 2]


@pytest.mark.parametrize(("used", "shown"), [(20, 18), (3, 3), (0, 1)])
def test_many_inputs_keep_the_most_used_and_none_that_nothing_refers_to(used: int, shown: int) -> None:
    names, counts = tuple(f"input_{k}" for k in range(60)), (0,) * (60 - used) + (9,) * used
    p = (0.5,) * (60 - used) + (0.01,) * used
    counted = Histogram(names, {"linear": counts}, {}, {}, {"linear": 9}, {}, p, p, 0.05)
    labels = [
        t.get_text()
        for t in drawn(dataclasses.replace(discovered(), histograms=(counted,)), "inputs_1").axes[0].get_yticklabels()
    ]
    assert len(labels) == shown
    assert not used or set(labels) <= set(names[60 - used :])


def test_partial_residual_is_shown_for_every_pose() -> None:
    report = discovered()
    shape = report.plots.shapes[0]
    axes = drawn(report, "shape_1").axes[0]
    points = np.vstack([c.get_offsets() for c in axes.collections])
    assert sorted(points[:, 1]) == sorted(shape.partial)
    assert axes.get_xlabel() == "J4, deg"


def test_parameters_are_drawn_with_one_deviation_to_each_side() -> None:
    report = discovered()
    first = next(p for p in report.parameters if p.unit == "rad" and p.kept)
    bar = drawn(report, "parameters_angles").axes[0].lines[1].get_xdata()
    assert np.allclose(bar, [1e6 * (first.value - first.stderr), 1e6 * (first.value + first.stderr)])


@pytest.mark.long
def test_the_pages_do_not_load_matplotlib() -> None:
    code = (
        "import sys, gpmodel.report.page, gpmodel.report.text, gpmodel.cli.results; print('matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("x", "gaps"), [(np.r_[0:30, 40:60], 1), (np.r_[0:60], 0), (np.repeat([-1.0, 1.0], 30), 0), (np.zeros(0), 0)]
)
def test_a_line_is_not_drawn_where_nobody_measured(x: np.ndarray, gaps: int) -> None:
    drawn_x, drawn_y = broken(x.astype(float), 2.0 * x)
    assert np.isnan(drawn_x).sum() == np.isnan(drawn_y).sum() == gaps
    assert drawn_x[np.isfinite(drawn_x)].tolist() == x.tolist()
    if gaps:
        assert drawn_x[29] == 29
        assert np.isnan(drawn_x[30])


def test_where_no_points_were_measured_there_is_no_picture_of_them() -> None:
    report = discovered()
    nothing = {name: tuple((None, None, None) for _ in rows) for name, rows in report.plots.residual_mm.items()}
    seen = dataclasses.replace(report, plots=dataclasses.replace(report.plots, residual_mm=nothing))
    assert not {"rows", "arrows_above"} & {p.name for p in pictures(seen)}


@pytest.mark.parametrize(("folds", "said"), [(0, "Filled dots: held out."), (5, "Residual of the fit to all poses.")])
def test_residuals_along_the_rows_say_which_fit_they_are_of(folds: int, said: str) -> None:
    made = discovered()
    report = dataclasses.replace(made, data=dataclasses.replace(made.data, folds=folds))
    (caption,) = (p.caption for p in pictures(report) if p.name == "rows")
    assert caption.endswith(said)


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


@pytest.mark.first(1)
@pytest.mark.parametrize("holdout", [0.3, 0.0])
def test_pictures_count_the_poses_that_the_stated_errors_count(holdout: float) -> None:
    arm, made = robot(60, seed=5)
    position = made.dataset.position.copy()
    position[[4, 17, 33], [0, 1, 2]] += [0.02, -0.035, 0.008]
    report = gp.calibrate(arm, replace(made.dataset, position=position), holdout=holdout).record
    assert len(report.data.outliers) == 3
    errors = report.ladder[-1].heldout if holdout else report.ladder[-1].train
    stated = f"{millimetres(errors.rms_mm)} mm RMS"
    texts = {picture.name: picture.alt for picture in pictures(report)}
    assert stated in texts["error_histogram"]
    assert stated in texts["cumulative"]
    assert stated in str([text.get_text() for axes in drawn(report, "error_histogram").axes for text in axes.texts])
    (shown,) = (text.get_text() for text in drawn(report, "rows").legends[0].get_texts())
    assert float(shown.split(", ")[1].split()[0]) < 2 * errors.rms_mm
