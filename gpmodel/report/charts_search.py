"""Draw pictures of the search, of evolved programs and of the fitted model."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.evolution.runs import Run
from gpmodel.numerics.rank import RankChoice
from gpmodel.report.picture import (
    AFTER,
    AXIS,
    BEFORE,
    INK,
    MOST_VECTORS,
    MUTED,
    NULL,
    PAPER,
    Picture,
    broken,
    forest,
    linked,
    log_axis,
    named_rows,
    numbers,
    rows_only,
    signed,
)
from gpmodel.report.schema import ParameterRecord, Report
from gpmodel.report.schema_search import CompensationRecord, RoundRecord, ShapeRecord
from gpmodel.report.words import operators, significant_inputs
from gpmodel.wording import millimetres, pretty_unit, short_name, shortened

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FILLED = (True, False, True, False)
"""Fill style of histogram bars by representation of evolved programs (linear, tree)."""
MOST_INPUTS = 18
"""Largest number of inputs in a histogram of the inputs of evolved programs."""


def pictures(report: Report) -> Iterator[Picture]:
    """Yield the pictures of search, evolved programs and fitted model for which the report has data."""
    yield from _of_search(report)
    yield from _of_programs(report)
    yield from _of_model(report)


def _of_search(report: Report) -> Iterator[Picture]:
    """Yield the pictures of the search for effects for which the report has data."""
    histograms = [h for h in report.histograms if h.inputs]
    for k, histogram in enumerate(histograms, 1):
        standing = significant_inputs(histogram)
        shown, unread = len(_shown(histogram)), len(histogram.inputs) - len(_shown(histogram))
        rest = f" Few or no programs contain the other {unread} inputs." if unread else ""
        yield Picture(
            f"inputs_{k}", f"Round {k}", 4.9, 1.1 + 0.21 * shown,
            f"Number of evolved programs that contain each input, on the residual and on permuted residuals; "
            f"significant inputs: {standing}.",
            f"Significant: {standing}.{rest}",
            partial(_inputs, histogram=histogram),
        )  # fmt: skip
    rounds = [r for r in report.rounds if r.candidates]
    chosen = frozenset(e.name for e in report.effects)
    if rounds:
        yield Picture(
            "search", "Net gain of the best candidates of each round", 10.2, 0.9 + 0.62 * len(rounds),
            f"Net gain of the candidates of {len(rounds)} rounds, and the best net gain on permuted "
            f"residuals; candidates in the model: "
            f"{sum(any(c.name in chosen for c in r.candidates) for r in rounds)}.",
            "Each dot is a candidate. Each mark 'chance' is the best net gain of a search on permuted residuals.",
            partial(_search, rounds=rounds, chosen=chosen),
        )  # fmt: skip


def _shown(histogram: Histogram) -> IntArray:
    """Return the indices of the inputs that most evolved programs contain, in the order of the histogram."""
    use = np.maximum(numbers(histogram.referring), numbers(histogram.referring_by_chance))
    most = np.argsort(-use, kind="stable")[:MOST_INPUTS]
    return np.sort(most[use[most] > 0]) if use.any() else most[:1]


def _inputs(figure: Figure, histogram: Histogram) -> None:
    axes = figure.subplots()
    names = histogram.inputs
    use, null, chances = (numbers(c) for c in (histogram.referring, histogram.referring_by_chance, histogram.p_values))
    kinds = [(name, numbers(c)) for name, c in histogram.counts.items() if any(c)]
    order = _shown(histogram)
    named_rows(axes, [names[k] for k in order])
    strong = set(histogram.significant)
    for row, k in enumerate(order):
        colour = AFTER if names[k] in strong else BEFORE
        left = 0.0
        for filled, (_, count) in zip(FILLED, kinds, strict=False):
            axes.barh(row - 0.18, count[k], 0.36, left=left, color=colour if filled else PAPER, ec=colour, lw=0.8)
            left += count[k]
        axes.barh(row + 0.2, null[k], 0.26, color=NULL)
        if names[k] in strong and chances[k] > 0:
            axes.annotate(f"p {chances[k]:.2g}", (use[k], row - 0.18), (4, 0), textcoords="offset points", va="center",
                          color=AFTER, fontsize=8.5, weight="bold")  # fmt: skip
    for tick, k in zip(axes.get_yticklabels(), order, strict=True):
        if names[k] in strong:
            tick.set(color=AFTER, weight="bold")
    axes.set_xlim(0, 1.18 * max(use.max(), null.max(), 1))
    axes.locator_params(axis="x", integer=True)
    axes.set_xlabel("best programs that contain the input")
    looks = zip(FILLED, kinds, strict=False)
    named = ", ".join(f"{name} ({'filled' if filled else 'hollow'})" for filled, (name, _) in looks)
    real = named if len(kinds) > 1 else "on the residual"
    for colour, label in ((BEFORE, real), (NULL, "on permuted residuals")):
        axes.barh(0, 0, color=colour, label=label)
    figure.legend(loc="outside upper right", ncols=2, labelcolor=MUTED)


def _search(figure: Figure, rounds: Sequence[RoundRecord], chosen: Collection[str]) -> None:
    """Draw the net gain, nats, of candidate effects in each round of the search. chosen: names of the effects in the
    model; one is labelled."""
    axes = figure.subplots()
    rows_only(axes, len(rounds), 0.6)
    for row, entry in enumerate(rounds):
        null = numbers(entry.null_nats)
        axes.scatter(null, np.full(len(null), row + 0.17), s=16, marker="|", color=NULL, lw=1.2)
        best = next((c for c in entry.candidates if c.name in chosen), None)
        for candidate in entry.candidates:
            value, won = candidate.nats, candidate.name in chosen
            if value is None:
                continue
            axes.scatter(
                value, row - 0.08, s=70 if won else 26, color=AFTER if won else BEFORE, lw=0, zorder=4 if won else 3
            )
            if candidate is best:
                axes.annotate(shortened(candidate.name, 60), (value, row - 0.08), (5, 5), va="bottom",
                              textcoords="offset points", ha="right", color=AFTER, weight="bold")  # fmt: skip
        if best is None:
            axes.text(1.0, row - 0.08, "no candidate was added", ha="right", va="center", color=MUTED,
                      transform=axes.get_yaxis_transform())  # fmt: skip
    axes.set_yticks(range(len(rounds)), [f"round {r.round}" for r in rounds])
    axes.tick_params(axis="y", length=0, labelcolor=INK)
    axes.axvline(0, color=AXIS, lw=0.8)
    signed(axes.xaxis)
    axes.set_xlabel("net gain, nats")
    for colour, label, mark in ((AFTER, "added", "o"), (BEFORE, "not added", "o"), (NULL, "chance", "|")):
        axes.scatter([], [], color=colour, marker=mark, s=30, label=label)
    figure.legend(loc="outside upper right", ncols=3, labelcolor=MUTED, handletextpad=0.3)


COLOURS = (AFTER, BEFORE, INK)
"""Colours of the curves that show outputs of an evolved program."""
MOST_PANELS = 6
"""Largest number of panels that show the best evolved program, three in a row."""


def _of_programs(report: Report) -> Iterator[Picture]:
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
        shown = min(len(best.inputs), MOST_PANELS)
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
    named_rows(axes, [row[0] for row in rows])
    for place, (_, *counts) in enumerate(rows):
        left = 0
        for filled, count in zip(FILLED, map(int, counts), strict=False):
            axes.barh(place, count, 0.6, left=left, color=AFTER if filled else PAPER, ec=AFTER, lw=0.8)
            left += count
    axes.locator_params(axis="x", integer=True)
    axes.set_xlabel("best programs that use it")


def _compensation(figure: Figure, best: CompensationRecord) -> None:
    shown = min(len(best.inputs), MOST_PANELS)
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


MOST_PARAMETERS = 36
"""Largest number of geometric parameters in a picture."""
KINDS = (("parameters_angles", "Angles", "rad", 1e6, "µrad"), ("parameters_lengths", "Lengths", "m", 1e6, "µm"))
"""Name, title, unit, scale and printed unit of each picture of geometric parameters."""


FEWEST_RANKS = 4
"""Least number of points at which cross-validated error against the number of constants is drawn."""


def _of_model(report: Report) -> Iterator[Picture]:
    """Yield the pictures of the fitted model for which the report has data."""
    for shape in report.plots.shapes[: len(report.effects)]:
        name = report.effects[shape.effect].name
        x_name = f"{shape.x_name}, {pretty_unit(shape.x_unit)}".rstrip(", ")
        if shape.x:
            yield Picture(
                f"shape_{shape.effect + 1}", f"Shape of {name}", 4.9, 3.3,
                f"Partial residual of {name} over {x_name}, with the fitted curve if this is the only input.",
                "Dots: partial residuals, the measured values minus all other terms of the model."
                + (" Line: the fitted effect." if shape.curve_x else ""),
                partial(_shape, shape=shape, x_name=x_name),
            )  # fmt: skip
    curve = list(report.rank_curve)
    if len(curve) >= FEWEST_RANKS:
        best = min(curve, key=lambda c: c.cv_rms)
        yield Picture(
            "rank_curve", "Error over the condition limit", 4.9, 3.3,
            f"Cross-validated error over the condition limit; lowest {millimetres(1e3 * best.cv_rms)} mm with "
            f"{best.rank} unknowns at a limit of {best.condition_limit:g}.",
            "Number of unknowns that these poses determine. The number at a dot is the rank at this condition limit.",
            partial(_rank, curve=curve, chosen=report.condition_limit),
        )  # fmt: skip
    for name, title, unit, scale, shown_unit in KINDS:
        chosen = [p for p in report.parameters if p.kept and p.value is not None and p.stderr and p.unit == unit]
        strongest = sorted(chosen, key=lambda p: -abs(p.value or 0.0) / (p.stderr or 1.0))[:MOST_PARAMETERS]
        rest = (
            ""
            if len(strongest) == len(chosen)
            else f" The figure has the {len(strongest)} most significant of {len(chosen)}."
        )
        if chosen:
            chosen = [p for p in chosen if any(p is s for s in strongest)]
            yield Picture(
                name, title, 4.9, 0.75 + 0.175 * len(chosen),
                f"{title} with one standard deviation, {len(chosen)} parameters, as in the table below.",
                f"Value ± σ. Hollow: within 2 σ of zero.{rest}",
                partial(_parameters, parameters=chosen, scale=scale, unit=shown_unit),
            )  # fmt: skip


def _shape(figure: Figure, shape: ShapeRecord, x_name: str) -> None:
    axes = figure.subplots()
    x, y = numbers(shape.x), numbers(shape.partial)
    held = np.array(shape.heldout or np.zeros(len(x)), dtype=bool)
    size, many = float(np.clip(1800 / len(x), 3, 18)), len(x) > MOST_VECTORS
    axes.axhline(0, color=AXIS, lw=0.8)
    rows = np.array(shape.rows or range(len(x)))
    train = axes.scatter(x[~held], y[~held], s=size, fc=PAPER, ec=BEFORE, lw=1.0, label="train", rasterized=many)
    linked(train, rows[~held].tolist(), many or not shape.rows)
    if held.any():
        full = axes.scatter(x[held], y[held], s=size, color=MUTED, lw=0, label="held out", zorder=3, rasterized=many)
        linked(full, rows[held].tolist(), many or not shape.rows)
    curve_x, curve_y = broken(numbers(shape.curve_x), numbers(shape.curve_y))
    if len(curve_x):
        axes.plot(curve_x, curve_y, color=AFTER, lw=2.4, label="fitted", zorder=4)
    axes.set(xlabel=x_name, ylabel=f"partial residual, {shape.y_unit}".rstrip(", "))
    signed(axes.xaxis, axes.yaxis)
    axes.grid(axis="both")
    figure.legend(loc="outside upper right", ncols=3, labelcolor=MUTED, handletextpad=0.4)


def _rank(figure: Figure, curve: Sequence[RankChoice], chosen: float | None) -> None:
    axes = figure.subplots()
    limit, rank, error = np.array([(c.condition_limit, c.rank, 1e3 * c.cv_rms) for c in curve]).T
    log_axis(axes, 0.6 * limit.min(), 1.8 * limit.max())
    if error.max() > 5 * error.min() > 0:
        log_axis(axes, 0.8 * error.min(), 1.4 * error.max(), "y")
    else:
        axes.set_ylim(min(0.0, error.min()), 1.2 * error.max())
    best = int(np.argmin(np.abs(np.log(limit / chosen)))) if chosen else int(np.argmin(error))
    axes.plot(limit, error, "o-", color=BEFORE, lw=1.4, ms=4.5)
    axes.plot(limit[best], error[best], "o", color=AFTER, ms=8.5)
    last = None
    for k in range(len(curve)):
        if rank[k] != last or k == best:
            here = k == best
            axes.annotate(f"{rank[k]:.0f}{' unknowns' if here else ''}", (limit[k], error[k]), (0, 8),
                          textcoords="offset points", ha="center", va="bottom", fontsize=8.5,
                          color=AFTER if here else MUTED, weight="bold" if here else "normal")  # fmt: skip
        last = rank[k]
    axes.set(xlabel="condition limit", ylabel="cross-validated RMS, mm")
    axes.grid(axis="both")


def _parameters(figure: Figure, parameters: Sequence[ParameterRecord], scale: float, unit: str) -> None:
    sizes = [(p.name, scale * (p.value or 0.0), scale * (p.stderr or 0.0)) for p in parameters]
    forest(figure.subplots(), [(short_name(n, 30), v, s, abs(v) > 2 * s) for n, v, s in sizes], unit)
