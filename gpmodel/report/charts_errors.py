"""Pictures of the size of the errors: error after each step, and distribution before and after."""

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
    MUTED,
    PAPER,
    Picture,
    log_axis,
    noise_floor,
    numbers,
    rms,
    rows_only,
)
from gpmodel.report.schema import REGISTRATION, Report, StepRecord
from gpmodel.wording import millimetres, shortened

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def pictures(report: Report) -> Iterator[Picture]:
    """Yield the pictures of error sizes for which the report has data."""
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
        which = _which(report)
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
    """Return title, errors (mm) at held-out poses and colour of each step."""
    out = []
    for k, rung in enumerate(report.ladder):
        sides = report.plots.error_mm.get(rung.step)
        error = numbers((sides.heldout if report.held else sides.train) if sides else ())
        error = error[np.isfinite(error)]
        if len(error):
            middle = AFTER_LIGHT if rung.beyond_standard else BEFORE
            last = k == len(report.ladder) - 1
            out.append((report.title(rung), error, AFTER if last else AXIS if rung.step == REGISTRATION else middle))
    return out


def _which(report: Report) -> str:
    data = report.data
    return f"{data.heldout} held-out {data.unit}" if report.held else f"the training {data.unit}"


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
