"""Pictures of evolved compensators: fitness over generations, operators, outputs of the best
program over its inputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.evolution.runs import Run
from gpmodel.report.picture import AFTER, BEFORE, INK, MUTED, NULL, PAPER, Picture, numbers
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import CompensationRecord
from gpmodel.report.words import operators
from gpmodel.wording import shortened

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = (AFTER, BEFORE, INK)
"""Colours of the outputs of a program."""
MOST_INPUTS = 6
"""Largest number of panels of the best program, three in a row."""


def pictures(report: Report) -> Iterator[Picture]:
    """Yield the pictures of evolved programs for which the report has data."""
    if any(run.history for run in report.runs):
        yield Picture(
            "fitness", "Gain over the generations", 4.9, 2.6,
            f"Gain of the best program so far in each of {len(report.runs)} runs, over the generations.",
            "Share of the scored residual that the best program so far removes.",
            partial(_fitness, runs=report.runs),
        )  # fmt: skip
        rows = operators(report.histograms[0])[1:]
        if rows:
            yield Picture(
                "operators", "Operators of the best programs", 4.9, 1.0 + 0.2 * len(rows),
                f"Best programs that use each of {len(rows)} operators.", ("Number of runs whose best program "
                "contains the operator."),
                partial(_operators, rows=rows),
            )  # fmt: skip
    best = report.compensation
    if best is not None and best.inputs and np.any(numbers(best.values)):
        shown = min(len(best.inputs), MOST_INPUTS)
        yield Picture(
            "compensation", f"The best program ({best.run}) over its inputs", 10.2, 2.5 * (1 + (shown - 1) // 3),
            f"Outputs of the best program at the training poses, over {', '.join(best.inputs[:shown])}.",
            "Each dot is a training pose. Angles are in rad; other columns are scaled to order one.",
            partial(_compensation, best=best),
        )  # fmt: skip


def _fitness(figure: Figure, runs: Sequence[Run]) -> None:
    axes = figure.subplots()
    kinds = list(dict.fromkeys(run.representation for run in runs))
    for run in runs:
        style = "-" if run.representation == kinds[0] else "--"
        generation, gain = (numbers(run.history[name]) for name in ("generation", "gain"))
        axes.plot(generation, 100.0 * gain, style, color=NULL if run.shuffled else AFTER, lw=1.2, alpha=0.8)
    for shuffled, colour in ((False, AFTER), (True, NULL)):
        for kind, style in zip(kinds, ("-", "--"), strict=False):
            axes.plot([], [], style, color=colour, label=f"{kind}{', shuffled' if shuffled else ''}")
    axes.set_xlabel("generation")
    axes.set_ylabel("removed, %")
    axes.grid(axis="y")
    figure.legend(loc="outside upper right", ncols=2, labelcolor=MUTED)


def _operators(figure: Figure, rows: Sequence[tuple[str, ...]]) -> None:
    axes = figure.subplots()
    axes.set_ylim(len(rows) - 0.4, -0.6)
    for place, (_, *counts) in enumerate(rows):
        left = 0
        for filled, count in zip((True, False, True, False), map(int, counts), strict=False):
            axes.barh(place, count, 0.6, left=left, color=AFTER if filled else PAPER, ec=AFTER, lw=0.8)
            left += count
    axes.set_yticks(range(len(rows)), [row[0] for row in rows])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.locator_params(axis="x", integer=True)
    axes.set_xlabel("best programs that use it")
    axes.grid(axis="x")


def _compensation(figure: Figure, best: CompensationRecord) -> None:
    shown = min(len(best.inputs), MOST_INPUTS)
    panels = figure.subplots(1 + (shown - 1) // 3, min(shown, 3), squeeze=False, sharey=True)
    for axes, name, column in zip(panels.flat, best.inputs, best.columns, strict=False):
        for colour, output, values in zip(COLOURS, best.outputs, best.values, strict=False):
            axes.plot(numbers(column), numbers(values), ".", ms=4, color=colour, label=shortened(output, 30))
        axes.set_xlabel(name)
        axes.grid(axis="y")
    for axes in panels.flat[shown:]:
        axes.set_visible(False)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3, labelcolor=MUTED)
