"""Draw pictures of position errors: size after each step, distribution, arrows in the workspace, residual by row."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.arrays import Array
from gpmodel.report.picture import (
    AFTER,
    AFTER_LIGHT,
    AXIS,
    BEFORE,
    CLIP,
    INK,
    MOST_VECTORS,
    MUTED,
    PAPER,
    RULE,
    Picture,
    linked,
    log_axis,
    nice_length,
    noise_floor,
    numbers,
    rms,
    rows_only,
    signed,
)
from gpmodel.report.poses import counted, errors_of
from gpmodel.report.schema import REGISTRATION, Report, StepRecord
from gpmodel.report.schema_search import MovedRecord
from gpmodel.wording import millimetres, shortened

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def pictures(report: Report) -> Iterator[Picture]:
    """Yield the pictures of position errors for which a report has data."""
    yield from _sizes(report)
    yield from _in_space(report)


def _sizes(report: Report) -> Iterator[Picture]:
    """Yield the pictures of error sizes and distributions for which a report has data."""
    rungs = [r for r in report.ladder if r.errors.known]
    if rungs:
        steps = "; ".join(f"{report.title(r)} {millimetres(r.errors.rms_mm)} mm" for r in rungs)
        yield Picture(
            "ladder", "Error after each step", 4.7, 0.75 + 0.56 * len(rungs),
            f"RMS of the 3-D error after each step of the model, {_side(report, rungs)}: {steps}.",
            "Dots: RMS of the 3-D error. The thin lines end at the largest error. The scale is logarithmic.",
            partial(_ladder, report=report, rungs=rungs),
        )  # fmt: skip
    errors = _errors(report)
    if errors:
        said = "; ".join(f"{n} {millimetres(rms(e))} mm RMS" for n, e, _ in errors)
        pair = [report.title(r) for r in report.ladder if r.step in report.before_and_after()]
        shown = [e for e in errors if e[0] in pair]
        data = report.data
        which = f"{len(errors[0][1])} held-out {data.unit}" if report.held else f"the training {data.unit}"
        which += " without outliers" if data.outliers else ""
        yield Picture(
            "error_histogram", "Error before and after" if len(shown) > 1 else "Distribution of the error", 4.9, 3.5,
            f"Histogram of the 3-D error of {which}, same bins for each step: {said}.",
            f"3-D error of {which}{', with equal bins before and after' if len(shown) > 1 else ''}.",
            partial(_histogram, errors=shown, floor=report.noise_floor_mm),
        )  # fmt: skip
        yield Picture(
            "cumulative", f"Share of the {report.data.unit} below an error", 4.9, 3.5,
            f"Cumulative share of {which} over the 3-D error, one curve a step: {said}.",
            f"Share of {which} whose 3-D error is below the value on the axis.",
            partial(_cumulative, errors=errors, floor=report.noise_floor_mm),
        )  # fmt: skip


def _side(report: Report, rungs: Sequence[StepRecord]) -> str:
    unit = report.data.unit
    return f"held-out {unit}" if all(r.heldout.known for r in rungs) else f"training {unit} (none were held out)"


def _errors(report: Report) -> list[tuple[str, Array, str]]:
    """Return title, errors at held-out poses, mm, and colour of each model in the sequence of calibrations, without
    outliers."""
    out, counts = [], counted(report)
    for k, rung in enumerate(report.ladder):
        error = errors_of(report, rung.step)
        error = error[counts & np.isfinite(error)] if len(error) else error
        if len(error):
            middle = AFTER_LIGHT if rung.beyond_standard else BEFORE
            last = k == len(report.ladder) - 1
            out.append((report.title(rung), error, AFTER if last else AXIS if rung.step == REGISTRATION else middle))
    return out


def _ladder(figure: Figure, report: Report, rungs: list[StepRecord]) -> None:
    axes = figure.subplots()
    values = [r.errors.rms_mm or 0.0 for r in rungs]
    largest = [r.errors.max_mm or v for r, v in zip(rungs, values, strict=True)]
    train = [r.train.rms_mm for r in rungs]
    floor = report.noise_floor_mm
    seen = [v for v in (*values, *largest, *train, floor) if v]
    log_axis(axes, 0.6 * min(seen), 1.4 * max(seen))
    rows_only(axes, len(rungs), 0.95)
    held = [r.heldout.known for r in rungs]
    for k, rung in enumerate(rungs):
        colour = AFTER if k == len(rungs) - 1 or rung.beyond_standard else BEFORE
        axes.plot([values[k], largest[k]], [k, k], color=colour, lw=1.2, alpha=0.55, solid_capstyle="butt")
        axes.plot(largest[k], k, "|", color=colour, ms=7, mew=1.2)
        if (seen_rms := train[k]) and held[k]:
            axes.plot(seen_rms, k, "o", mfc=PAPER, mec=colour, mew=1.4, ms=6.5, zorder=3)
        axes.plot(values[k], k, "o", color=colour, ms=8.5, zorder=4)
        axes.annotate(f"{millimetres(values[k])} mm", (values[k], k), (0, 7), textcoords="offset points", ha="center",
                      va="bottom", color=colour if colour == AFTER else MUTED, weight="bold", fontsize=9.5,
                      bbox={"fc": PAPER, "ec": "none", "pad": 0.6})  # fmt: skip
    axes.set_yticks(range(len(rungs)), [fill(shortened(report.title(r), 36), 21) for r in rungs])
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    if floor:
        noise_floor(axes, floor)
    key = (
        "3-D error, mm  (● RMS held out  ○ RMS train  | max)" if any(held) else "3-D error, mm   (● RMS train   | max)"
    )
    axes.set_xlabel(key)


def _histogram(figure: Figure, errors: list[tuple[str, Array, str]], floor: float | None) -> None:
    together = np.concatenate([e for _, e, _ in errors])
    reach = min(together.max(), CLIP * np.percentile(together, 98))
    count = int(np.clip(2 * np.sqrt(min(len(e) for _, e, _ in errors)), 10, 40))
    bins = np.linspace(0, reach * 1.0001, count + 1)
    panels = figure.subplots(len(errors), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axes, (name, error, colour) in zip(panels, errors, strict=True):
        axes.hist(error, bins, color=colour, rwidth=0.92)
        axes.grid(axis="y")
        axes.set_ylabel("number")
        axes.yaxis.get_major_locator().set_params(integer=True, nbins=4)
        beyond = int(np.sum(error > bins[-1]))
        note = f"\n{beyond} beyond the axis" if beyond else ""
        axes.text(1.0, 0.98, f"{shortened(name, 38)}\n{millimetres(rms(error))} mm RMS{note}", ha="right", va="top",
                  transform=axes.transAxes, color=AFTER if colour == AFTER else MUTED, weight="bold")  # fmt: skip
        if floor and floor < bins[-1]:
            noise_floor(axes, floor, INK, said=axes is panels[-1])
    panels[-1].set_xlabel("3-D error, mm")
    panels[-1].set_xlim(0, bins[-1])


def _cumulative(figure: Figure, errors: list[tuple[str, Array, str]], floor: float | None) -> None:
    axes = figure.subplots()
    named: set[str] = set()
    low = min(np.percentile(e, 2) for _, e, _ in errors)
    log_axis(axes, max(0.7 * low, 1e-7), 1.3 * max(e.max() for _, e, _ in errors) + 1e-7)
    for name, error, colour in errors:
        ordered = np.sort(error)
        share = np.arange(1, len(ordered) + 1) / len(ordered)
        between = colour == AFTER_LIGHT
        width = 2.2 if colour in (AFTER, BEFORE) else 1.4
        label = "steps between" if between else shortened(name, 30)
        axes.step(ordered, 100 * share, where="post", color=colour, lw=width, label=None if label in named else label)
        named.add(label)
    if floor and floor < axes.get_xlim()[1]:
        noise_floor(axes, floor, said=False)
    axes.set(ylim=(0, 101), xlabel="3-D error, mm", ylabel="share, %")
    axes.grid(axis="both")
    figure.legend(loc="outside upper left", ncols=2, labelcolor=MUTED, columnspacing=1.2)


SHARE_OF_SPAN = 0.13
"""Length of a typical error arrow relative to the size of the workspace, so that arrows do not overlap."""
ARROWS = 250
"""Largest number of poses drawn in a picture of errors, evenly spaced along the rows."""


def _in_space(report: Report) -> Iterator[Picture]:
    """Yield the pictures of residual arrows seen from above, displacement by each effect, and residual by row."""
    yield from _arrow_pictures(report)
    for number, effect in enumerate(report.effects, 1):
        if effect.moved is not None and effect.moved.points_mm:
            yield _moved_picture(number, effect.name, effect.moved)
    residual = report.plots.residual_mm
    after = numbers(residual.get("final", ()))
    if np.isfinite(after).any():
        before = numbers(residual.get(report.before_and_after()[0], ()) if report.effects else ())
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
    first = report.step(report.before_and_after()[0])
    before = numbers(residual[first.step]) if report.effects and first else after
    whole = np.isfinite(points).all(axis=1) & np.isfinite(after).all(axis=1) & np.isfinite(before).all(axis=1)
    chosen = np.flatnonzero(whole)
    chosen = chosen[:: max(1, -(-len(chosen) // ARROWS))]
    if len(chosen) == 0:
        return
    points, before, after = points[chosen], before[chosen], after[chosen]
    magnification = _magnification(points, before)
    some = "" if len(chosen) == whole.sum() else f" {len(chosen)} of {int(whole.sum())} poses are shown."
    models = (
        f"{report.title(first)} (grey) and of the final model (blue)" if report.effects and first else "standard model"
    )
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
    """Return the magnification at which the 90th percentile of the error arrows is SHARE_OF_SPAN of the workspace."""
    typical = float(np.percentile(np.linalg.norm(moves, axis=1), 90))
    return SHARE_OF_SPAN * (float(np.ptp(points, axis=0).max()) or 1.0) / (typical or 1.0)


def _arrows(
    figure: Figure,
    points: Array,
    moves: Sequence[tuple[Array, str]],
    magnification: float,
    sides: Sequence[tuple[int, int]],
) -> None:
    """Draw error arrows, one colour for each kind, and a scale, in one panel per pair of axes in `sides`."""
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
        if len(values) == len(row):
            lengths = np.linalg.norm(values[np.isin(row, outliers, invert=True)], axis=1)
            panels[0].scatter([], [], s=18, color=colour, label=f"{name}, {millimetres(rms(lengths))} mm RMS")
    figure.legend(loc="outside upper right", ncols=2, labelcolor="markeredgecolor")
