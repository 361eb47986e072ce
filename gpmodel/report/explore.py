"""explore.html: rotatable 3-D view of the arm, the poses and the residuals before and after, made from a Report."""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.report.page import render
from gpmodel.report.picture import nice_length, numbers
from gpmodel.report.poses import pose_errors
from gpmodel.report.schema import REGISTRATION, STANDARD, Report
from gpmodel.wording import millimetres

PAGE = "explore.html"
CAMERA = {"eye": {"x": 1.5, "y": 1.5, "z": 0.9}, "center": {"x": 0.0, "y": 0.0, "z": -0.12}}
"""Viewpoint of the 3-D view from which no coordinate axis is cut off."""
SCALE = [[0.0, "#3d8fd6"], [0.5, "#b98a2f"], [1.0, "#d0452b"]]
"""Colours from small errors (blue) to large errors (red)."""
WORST = 30
"""Number of poses listed next to the 3-D view, in order of decreasing error."""
LONGEST = 0.12
"""Length of the arrow for the 90th percentile of the residuals before calibration, relative to the span of the poses.
"""
MOST = 3000
"""Largest number of poses in the 3-D view, evenly spaced along the rows; the file then stays below 6 MB."""
COLOURS = {"before": "#868d98", "after": "#3d8fd6", "arm": "#8e63ce", "slot": "#868d98"}
"""Colours of arm and arrows with a contrast of at least 3 on light and dark paper."""


def drawable(report: Report) -> bool:
    """Return True if the report has positions and residuals to draw."""
    residual = report.plots.residual_mm.get("final", ())
    return len(residual) > 0 and bool(np.isfinite(numbers(residual)).any())


def html(report: Report) -> str:
    """Return the 3-D view of the arm as HTML that includes the drawing library, so that the page opens offline."""
    from plotly.offline import get_plotlyjs

    figure, magnification = figure_of(report)
    return render(
        "explore.html.j2", report=report, figure=figure, plotly=get_plotlyjs(), magnification=magnification,
        steps=_titles(report), every=every_so_many(report), worst=pose_errors(report)[:WORST],
    )  # fmt: skip


def _titles(report: Report) -> tuple[str, str]:
    before, after = (report.step(name) for name in report.before_and_after())
    found = len(report.effects) if after and after.beyond_standard else 0
    with_all = f"with all {found} findings" if found > 1 else report.title(after) if after else "after"
    return (report.title(before) if before else "before", with_all)


def figure_of(report: Report) -> tuple[dict[str, object], float]:
    """Return traces and layout of the 3-D view for the drawing library, and the magnification of the residuals."""
    plots = report.plots
    every = every_so_many(report)
    points, after = numbers(plots.points_mm)[::every], numbers(plots.residual_mm["final"])[::every]
    step = STANDARD if report.before_and_after()[0] == STANDARD else REGISTRATION
    before = numbers(plots.residual_mm.get(step, plots.residual_mm["final"]))[::every]
    size = np.linalg.norm(before, axis=1)
    typical = float(np.nanpercentile(size, 90)) if np.isfinite(size).any() else 1.0
    span = float(np.ptp(points, axis=0).max()) or 1.0
    magnification = nice_length(LONGEST * span / (typical or 1.0))
    said = _hover(report)[::every]
    titles = _titles(report)
    traces = [
        _arrows(points, before, magnification, titles[0], COLOURS["before"]),
        _arrows(points, after, magnification, titles[1], COLOURS["after"]),
        _dots(points, said, np.linalg.norm(after, axis=1)),
        _mark(),
    ]
    if plots.chain_mm:
        slots = _table_slots(report)
        traces.append(_arm(numbers(plots.chain_mm[0]), slots, f"arm at row {plots.rows[plots.chain_poses[0]]}"))
    arms = {
        str(plots.rows[pose]): numbers(chain).round(1).tolist()
        for pose, chain in zip(plots.chain_poses, plots.chain_mm, strict=True)
    }
    axis = {"showbackground": False, "zeroline": False, "nticks": 6}
    scene = {f"{a}axis": {"title": {"text": f"{a}, mm"}, **axis} for a in "xyz"} | {
        "aspectmode": "data",
        "camera": CAMERA,
    }
    layout = {
        "scene": scene, "margin": {"l": 0, "r": 0, "t": 0, "b": 0}, "showlegend": True, "uirevision": "kept",
        "paper_bgcolor": "rgba(0,0,0,0)", "legend": {"x": 0, "y": 1, "bgcolor": "rgba(0,0,0,0)", "orientation": "h"},
    }  # fmt: skip
    return {"data": traces, "layout": layout, "arms": arms}, magnification


def _table_slots(report: Report) -> tuple[str, ...]:
    """Return the names of the frames with the joint names of the table, if each joint has two frames (slots)."""
    slots, joints = report.plots.slots, report.mechanism.joints
    own = list(dict.fromkeys(s.partition(".")[0] for s in slots if "." in s))
    names = dict(zip(own, joints, strict=True)) if len(own) == len(joints) else {}
    return tuple(names.get(s.partition(".")[0], s.partition(".")[0]) + "".join(s.partition(".")[1:]) for s in slots)


def every_so_many(report: Report) -> int:
    """Return the number of rows between two poses that the 3-D view shows."""
    return max(1, -(-len(report.plots.points_mm) // MOST))


def _hover(report: Report) -> list[tuple[int, str]]:
    """Return the row number and the hover text of every pose of the 3-D view, in the order of the rows."""
    errors = {p.row: p for p in pose_errors(report)}
    out = []
    for row in report.plots.rows:
        p = errors.get(row)
        if p is None:
            out.append((row, f"row {row}"))
            continue
        kind = f"{'held out' if p.heldout else 'training'}{', outlier' if p.outlier else ''}"
        out.append((row, f"row {row}, {kind}<br>before {millimetres(p.before)} mm<br>after {millimetres(p.after)} mm"))
    return out


def _plain(values: Array) -> list[float | None]:
    return [round(float(v), 3) if np.isfinite(v) else None for v in values]


def _arrows(points: Array, residual: Array, magnification: float, name: str, colour: str) -> dict[str, object]:
    """Return lines from each measured point along its magnified residual, separated by gaps."""
    ends = points + magnification * residual
    gap = np.full_like(points, np.nan)
    lines = np.stack([points, ends, gap], axis=1).reshape(-1, 3)
    return {
        "type": "scatter3d", "mode": "lines", "name": name, "hoverinfo": "skip", "line": {"color": colour, "width": 4},
        **{a: _plain(lines[:, i]) for i, a in enumerate("xyz")},
    }  # fmt: skip


def _dots(points: Array, said: list[tuple[int, str]], error: Array) -> dict[str, object]:
    """Return a dot per pose, coloured by the error after calibration, mm, up to the 98th percentile."""
    most = float(np.nanpercentile(error, 98)) if np.isfinite(error).any() else 1.0
    return {
        "type": "scatter3d", "mode": "markers", "name": "poses", "hoverinfo": "text", "text": [t for _, t in said],
        "customdata": [row for row, _ in said], "marker": {
            "size": 4, "color": _plain(error), "colorscale": SCALE, "cmin": 0.0, "cmax": most or 1.0, "showscale": True,
            "colorbar": {"title": {"text": "after, mm"}, "len": 0.5, "y": 0.3, "thickness": 12},
        },
        **{a: _plain(points[:, i]) for i, a in enumerate("xyz")},
    }  # fmt: skip


def _mark() -> dict[str, object]:
    """Return the marker of the pose that the user selects in the 3-D view, initially empty."""
    return {
        "type": "scatter3d", "mode": "markers", "name": "chosen pose", "hoverinfo": "skip", "x": [], "y": [], "z": [],
        "marker": {"size": 13, "symbol": "circle-open", "color": COLOURS["arm"]}, "showlegend": False,
    }  # fmt: skip


def _arm(chain: Array, slots: tuple[str, ...], name: str) -> dict[str, object]:
    return {
        "type": "scatter3d", "mode": "lines+markers", "name": name, "hoverinfo": "text", "text": list(slots),
        "line": {"color": COLOURS["arm"], "width": 8}, "marker": {"size": 5, "color": COLOURS["arm"]},
        **{a: _plain(chain[:, i]) for i, a in enumerate("xyz")},
    }  # fmt: skip
