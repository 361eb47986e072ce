"""Pictures of the residual and of the displacement by each effect as arrows in the workspace, and of the residual by
row."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.arrays import Array
from gpmodel.report.picture import (
    AFTER,
    AXIS,
    BEFORE,
    CLIP,
    INK,
    MOST_VECTORS,
    MUTED,
    RULE,
    Picture,
    linked,
    nice_length,
    numbers,
    rms,
    signed,
)
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import MovedRecord
from gpmodel.wording import millimetres

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHARE_OF_SPAN = 0.13
"""Length of a typical arrow relative to the size of the workspace: neighbours do not overlap."""
ARROWS = 250
"""Largest number of poses drawn, evenly spaced along the rows."""


def pictures(report: Report) -> Iterator[Picture]:
    """Yield arrows from above, the displacement by each effect, and the residual by row, if points were measured."""
    yield from _arrow_pictures(report)
    for number, effect in enumerate(report.effects, 1):
        if effect.moved is not None and effect.moved.points_mm:
            yield _moved_picture(number, effect.name, effect.moved)
    residual = report.plots.residual_mm
    after = numbers(residual.get("final", ()))
    if np.isfinite(after).any():
        before = numbers(residual["standard"] if report.effects else ())
        fitted = "Residual of the fit to all poses." if report.data.folds else "Filled dots: held out."
        yield Picture(
            "rows", "Residual along the rows", 10.2, 4.6,
            "Components x, y, z of the residual over the row of the table, before and after; outliers are marked.",
            ("A jump indicates that the set-up moved, a slope indicates drift, a wide band indicates larger "
            "noise. ") + fitted,
            partial(_rows, report=report, before=before, after=after),
        )  # fmt: skip


def _arrow_pictures(report: Report) -> Iterator[Picture]:
    residual = report.plots.residual_mm
    points, after = numbers(report.plots.points_mm), numbers(residual.get("final", ()))
    if len(points) == 0 or points.shape != after.shape:
        return
    before = numbers(residual["standard"]) if report.effects else after
    whole = np.isfinite(points).all(axis=1) & np.isfinite(after).all(axis=1) & np.isfinite(before).all(axis=1)
    chosen = np.flatnonzero(whole)
    chosen = chosen[:: max(1, -(-len(chosen) // ARROWS))]
    if len(chosen) == 0:
        return
    points, before, after = points[chosen], before[chosen], after[chosen]
    magnification = _magnification(points, before)
    some = "" if len(chosen) == whole.sum() else f" {len(chosen)} of {int(whole.sum())} poses are shown."
    models = "standard model (grey) and of the final model (blue)" if report.effects else "standard model"
    colours = "Grey before, blue after. " if report.effects else ""
    shown = [(before, BEFORE), (after, AFTER)] if report.effects else [(after, AFTER)]
    yield Picture(
        "arrows_above", "Seen from above", 4.9, 4.6,
        f"Residual of the {models} as arrows at the nominal positions: x and y.",
        (f"{colours}Residual {float(f'{magnification:.2g}'):,.0f} times enlarged. See explore.html for a 3-D "
        f"view.{some}"),
        partial(_arrows, points=points, moves=shown, magnification=magnification, sides=((0, 1),)),
    )  # fmt: skip


def _moved_picture(number: int, name: str, moved: MovedRecord) -> Picture:
    points, moves = numbers(moved.points_mm), numbers(moved.moves_mm)
    magnification = _magnification(points, moves)
    where = "at random joint values within the limits" if moved.anywhere else "at measured poses"
    return Picture(
        f"moved_{number}", f"Displacement of the tool by {name}", 4.9, 2.5,
        f"Displacement of the tool by {name} as arrows {where}, from above and from the side.",
        f"Arrows: displacement of the tool {where}, {float(f'{magnification:.2g}'):,.0f} times enlarged; from above "
        "and from the side.",
        partial(_arrows, points=points, moves=[(moves, AFTER)], magnification=magnification, sides=((0, 1), (0, 2))),
    )  # fmt: skip


def _magnification(points: Array, moves: Array) -> float:
    """Return the magnification at which the 90th percentile of the arrows is SHARE_OF_SPAN of the workspace."""
    typical = float(np.percentile(np.linalg.norm(moves, axis=1), 90))
    return SHARE_OF_SPAN * (float(np.ptp(points, axis=0).max()) or 1.0) / (typical or 1.0)


def _arrows(
    figure: Figure,
    points: Array,
    moves: Sequence[tuple[Array, str]],
    magnification: float,
    sides: Sequence[tuple[int, int]],
) -> None:
    """Draw arrows, each kind in its colour, and their scale, in one panel per pair of axes in `sides`."""
    figure.set_layout_engine("compressed")  # constrained layout cuts the labels of equal axes
    for axes, side in zip(figure.subplots(1, len(sides), squeeze=False)[0], sides, strict=True):
        _seen_from(axes, points[:, side], [(move[:, side], colour) for move, colour in moves], magnification)
        axes.set(xlabel=f"{'xyz'[side[0]]}, mm", ylabel=f"{'xyz'[side[1]]}, mm")


def _seen_from(axes: Axes, points: Array, moves: Sequence[tuple[Array, str]], magnification: float) -> None:
    span = float(np.ptp(points, axis=0).max()) or 1.0
    axes.scatter(points[:, 0], points[:, 1], s=3, color=AXIS, lw=0)
    for move, colour in moves:
        axes.quiver(*points.T, *move.T, color=colour, angles="xy",
                    scale_units="xy", scale=1.0 / magnification, units="inches", width=0.023, headwidth=3.6,
                    headlength=4.0, headaxislength=3.6)  # fmt: skip
    middle = points.min(axis=0) / 2 + points.max(axis=0) / 2
    half = 0.62 * span
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    left, low = middle - 0.58 * span
    key = nice_length(0.16 * span / magnification)
    axes.plot([left, left + key * magnification], [low, low], color=INK, lw=2.2, solid_capstyle="butt")
    axes.text(left, low + 0.02 * span, f"{key:g} mm", color=INK, fontsize=8.5, va="bottom")
    axes.set_aspect("equal")
    axes.locator_params(nbins=5)
    signed(axes.xaxis, axes.yaxis)
    axes.tick_params(labelcolor=MUTED)
    axes.grid(axis="both")


def _rows(figure: Figure, report: Report, before: Array, after: Array) -> None:
    panels = figure.subplots(3, 1, sharex=True, sharey=True)
    held = np.array(report.plots.heldout_mask or np.zeros(len(after)), dtype=bool)
    outliers = report.data.outliers
    row = np.array(report.plots.rows or range(1, len(after) + 1))
    everything = np.abs(np.concatenate([before.reshape(-1), after.reshape(-1)]))
    everything = everything[np.isfinite(everything)]
    reach = 1.08 * min(everything.max(), CLIP * np.percentile(everything, 98)) or 1.0
    size, many = float(np.clip(900 / len(row), 2, 16)), len(row) > MOST_VECTORS
    series = [(before, BEFORE, "standard model"), (after, AFTER, "final model" if len(before) else "standard model")]
    for axis, axes in enumerate(panels):
        axes.axhline(0, color=AXIS, lw=0.8)
        for values, colour, _ in series:
            if len(values) == len(row):
                clipped = np.clip(values[:, axis], -reach, reach)
                hollow = axes.scatter(row[~held], clipped[~held], s=size, fc="none", ec=colour, lw=0.9, rasterized=many)
                full = axes.scatter(row[held], clipped[held], s=size, color=colour, lw=0.9, rasterized=many)
                linked(hollow, row[~held].tolist(), many)
                linked(full, row[held].tolist(), many)
        for outlier in outliers:
            axes.axvline(outlier, color=RULE, lw=3, zorder=0)
        axes.set_ylabel(f"{'xyz'[axis]}, mm")
        axes.set_ylim(-reach * 1.05, reach * 1.05)
        axes.grid(axis="y")
        signed(axes.yaxis)
    for outlier in outliers[:12]:
        panels[0].annotate(f"outlier {outlier}", (outlier, 1.0), xycoords=("data", "axes fraction"), ha="center",
                           va="bottom", fontsize=8, color=MUTED)  # fmt: skip
    panels[-1].set_xlabel("row of the table")
    panels[-1].set_xlim(row.min() - 1, row.max() + 1)
    for values, colour, name in series:
        if len(values):
            panels[0].scatter(
                [], [], s=18, color=colour, label=f"{name}, {millimetres(rms(np.linalg.norm(values, axis=1)))} mm RMS"
            )
    figure.legend(loc="outside upper right", ncols=2, labelcolor="markeredgecolor")
