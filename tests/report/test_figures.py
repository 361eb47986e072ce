import json
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import report_cases
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from gpmodel.files import to_json
from gpmodel.report import figures as plots
from gpmodel.report.picture import AFTER, BEFORE, NULL
from gpmodel.report.saved import from_json

CASES = {"found": report_cases.found, "sparse": report_cases.sparse}
ALWAYS = {"ladder"}
RESIDUAL = {"error_histogram", "cumulative", "arrows_above", "arrows_side", "arrows_front", "rows"}
MODEL = {"search", "rank_curve", "parameters_angles", "parameters_lengths"}
EXPECTED = {
    "found": ALWAYS | RESIDUAL | MODEL | {"shape_1", "shape_2", "inputs_1", "inputs_2", "inputs_3"},
    "sparse": ALWAYS,
}


def drawn(report: dict[str, Any], name: str) -> Any:
    picture = next(p for p in plots.pictures(from_json(to_json(report))) if p.name == name)
    figure = Figure(figsize=(picture.width, picture.height))
    picture.draw(figure)
    return figure


@pytest.mark.parametrize("case", CASES)
def test_every_picture_the_numbers_allow_is_a_png_of_its_size(case: str, tmp_path: Path) -> None:
    report = json.loads(json.dumps(CASES[case]()))
    files = plots.write_figures(from_json(to_json(report)), tmp_path)
    sizes = {p.name: (p.width, p.height) for p in plots.pictures(from_json(to_json(report)))}
    assert set(files) == EXPECTED[case]
    for name, path in files.items():
        content = path.read_bytes()
        assert path == tmp_path / "figures" / f"{name}.png"
        assert content[:8] == b"\x89PNG\r\n\x1a\n"
        expected = [plots.DOTS_PER_INCH * s for s in sizes[name]]
        assert np.allclose(struct.unpack(">II", content[16:24]), expected, atol=1.0)


def test_the_same_report_gives_the_same_files(tmp_path: Path) -> None:
    report = report_cases.sparse()
    first, second = (plots.write_figures(from_json(to_json(report)), tmp_path / k)["ladder"] for k in ("a", "b"))
    assert first.read_bytes() == second.read_bytes()


def test_ladder_puts_filled_dots_at_held_out_and_hollow_ones_at_training_errors() -> None:
    report = report_cases.found()
    lines = drawn(report, "ladder").axes[0].lines
    dots = [line for line in lines if line.get_marker() == "o"]
    filled = [float(np.ravel(d.get_xdata())[0]) for d in dots if d.get_markerfacecolor() != "white"]
    hollow = [float(np.ravel(d.get_xdata())[0]) for d in dots if d.get_markerfacecolor() == "white"]
    assert filled == [r["heldout"]["rms_mm"] for r in report["ladder"]]
    assert hollow == [r["train"]["rms_mm"] for r in report["ladder"]]


def test_error_histogram_shares_bins_and_counts_every_held_out_pose() -> None:
    report = report_cases.found()
    before, after = drawn(report, "error_histogram").axes
    assert [p.get_x() for p in before.patches] == [p.get_x() for p in after.patches]
    assert [to_hex(a.patches[0].get_facecolor()) for a in (before, after)] == [BEFORE, AFTER]
    for axes in (before, after):
        assert sum(p.get_height() for p in axes.patches) == report["data"]["heldout"]


def test_error_beyond_the_axis_is_said_not_dropped() -> None:
    report = report_cases.nothing()
    report["plots"]["error_mm"]["standard"]["heldout"] = [0.03 + 0.001 * k for k in range(99)] + [40.0]
    axes = drawn(report, "error_histogram").axes[0]
    assert axes.get_xlim()[1] < 1.0
    assert any("1 beyond the axis" in text.get_text() for text in axes.texts)


def test_cumulative_ends_at_all_poses_and_the_largest_error() -> None:
    report = report_cases.found()
    curves = [line for line in drawn(report, "cumulative").axes[0].lines if len(line.get_xdata()) > 2]
    for curve, rung in zip(curves, report["ladder"], strict=True):
        assert curve.get_ydata()[-1] == 100.0
        assert curve.get_xdata()[-1] == rung["heldout"]["max_mm"]


@pytest.mark.parametrize(("name", "plane"), [("above", (0, 1)), ("side", (0, 2)), ("front", (1, 2))])
def test_arrows_start_at_the_tip_and_show_the_residual(name: str, plane: tuple[int, int]) -> None:
    report = report_cases.found()
    numbers = report["plots"]
    points = np.array(numbers["points_mm"])
    quivers = [c for c in drawn(report, f"arrows_{name}").axes[0].collections if hasattr(c, "U")]
    for quiver, step in zip(quivers, ("standard", "final"), strict=True):
        residual = np.array(numbers["residual_mm"][step])
        assert np.allclose(quiver.get_offsets(), points[:, plane])
        assert np.allclose(np.column_stack([quiver.U, quiver.V]), residual[:, plane])


def test_poses_without_a_measurement_are_left_out_of_the_arrows_and_rows() -> None:
    report = report_cases.found()
    report["plots"]["residual_mm"]["final"][3] = [None, None, None]
    quiver = next(c for c in drawn(report, "arrows_above").axes[0].collections if hasattr(c, "U"))
    assert len(quiver.U) == len(report["plots"]["points_mm"]) - 1
    assert drawn(report, "rows").axes


def test_input_bars_show_counts_beside_the_null_in_its_own_colour() -> None:
    report = report_cases.found()
    histogram = report["histograms"][0]
    bars = [p for p in drawn(report, "inputs_1").axes[0].patches if p.get_height() < 0.5]
    null = [p.get_width() for p in bars if to_hex(p.get_facecolor()) == NULL]
    blue = [p.get_width() for p in bars if to_hex(p.get_facecolor()) == AFTER]
    assert null == histogram["shuffled"]
    assert blue == [histogram["linear"][histogram["inputs"].index("J4")]]


def test_many_inputs_keep_the_most_used() -> None:
    names = [f"input_{k}" for k in range(60)]
    counts = [0] * 59 + [9]
    histogram = {"inputs": names, "linear": counts, "tree": [0] * 60, "shuffled": [0] * 60, "significant": names[-1:]}
    report = report_cases.sparse() | {"histograms": [histogram]}
    labels = [t.get_text() for t in drawn(report, "inputs_1").axes[0].get_yticklabels()]
    assert len(labels) == 18
    assert "input_59" in labels


def test_partial_residual_is_shown_for_every_pose() -> None:
    report = report_cases.found()
    shape = report["plots"]["shapes"][0]
    axes = drawn(report, "shape_1").axes[0]
    points = np.vstack([c.get_offsets() for c in axes.collections])
    assert sorted(points[:, 1]) == sorted(shape["partial"])
    assert axes.get_xlabel() == "J4, deg"


def test_parameters_are_drawn_with_one_deviation_to_each_side() -> None:
    report = report_cases.found()
    first = next(p for p in report["parameters"] if p["unit"] == "rad" and p["kept"])
    bar = drawn(report, "parameters_angles").axes[0].lines[1].get_xdata()
    assert np.allclose(bar, [1e6 * (first["value"] - first["stderr"]), 1e6 * (first["value"] + first["stderr"])])


def _no_residual(report: dict[str, Any]) -> None:
    del report["plots"]["residual_mm"]


def _no_effects(report: dict[str, Any]) -> None:
    report["effects"] = []


def _no_mask(report: dict[str, Any]) -> None:
    report["plots"]["heldout_mask"] = []


def _no_chance(report: dict[str, Any]) -> None:
    for entry in report["rounds"]:
        entry["null_nats"] = []
        for candidate in entry["candidates"]:
            candidate["p_value"] = None


@pytest.mark.parametrize("change", [_no_residual, _no_effects, _no_mask, _no_chance])
def test_what_is_missing_is_not_drawn_and_the_rest_is(change: Callable[[dict[str, Any]], None]) -> None:
    report = report_cases.found()
    change(report)
    for picture in plots.pictures(from_json(to_json(report))):
        figure = Figure(figsize=(picture.width, picture.height))
        picture.draw(figure)
        assert figure.axes, picture.name


def test_the_pages_module_does_not_load_matplotlib() -> None:
    code = "import sys, gpmodel.report.page, gpmodel.cli.report; print('matplotlib' in sys.modules)"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
        == "False"
    )
