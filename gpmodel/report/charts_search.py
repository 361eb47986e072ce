"""Pictures of the search: input counts and gains of candidates, each with its permutation null."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.evolution.input_histogram import Histogram
from gpmodel.report.picture import AFTER, AXIS, BEFORE, INK, MUTED, NULL, PAPER, Picture, numbers, rows_only, signed
from gpmodel.report.schema import Report
from gpmodel.report.schema_search import RoundRecord
from gpmodel.report.words import significant_inputs
from gpmodel.wording import shortened

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FILLED = (True, False, True, False)
"""Fill of the bars of each representation."""
MOST_INPUTS = 18
"""Largest number of inputs in a histogram."""


def pictures(report: Report) -> Iterator[Picture]:
    """Yield the pictures of the search for which the report has data."""
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
    """Return the indices (K,) of the most referenced inputs, in the order of the histogram."""
    use = np.maximum(numbers(histogram.referring), numbers(histogram.referring_by_chance))
    most = np.argsort(-use, kind="stable")[:MOST_INPUTS]
    return np.sort(most[use[most] > 0]) if use.any() else most[:1]


def _inputs(figure: Figure, histogram: Histogram) -> None:
    axes = figure.subplots()
    names = histogram.inputs
    use, null, chances = (numbers(c) for c in (histogram.referring, histogram.referring_by_chance, histogram.p_values))
    kinds = [(name, numbers(c)) for name, c in histogram.counts.items() if any(c)]
    order = _shown(histogram)
    axes.set_ylim(len(order) - 0.4, -0.6)
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
    axes.set_yticks(range(len(order)), [names[k] for k in order])
    for tick, k in zip(axes.get_yticklabels(), order, strict=True):
        if names[k] in strong:
            tick.set(color=AFTER, weight="bold")
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlim(0, 1.18 * max(use.max(), null.max(), 1))
    axes.locator_params(axis="x", integer=True)
    axes.set_xlabel("best programs that contain the input")
    axes.grid(axis="x")
    looks = zip(FILLED, kinds, strict=False)
    named = ", ".join(f"{name} ({'filled' if filled else 'hollow'})" for filled, (name, _) in looks)
    real = named if len(kinds) > 1 else "on the residual"
    for colour, label in ((BEFORE, real), (NULL, "on permuted residuals")):
        axes.barh(0, 0, color=colour, label=label)
    figure.legend(loc="outside upper right", ncols=2, labelcolor=MUTED)


def _search(figure: Figure, rounds: Sequence[RoundRecord], chosen: Collection[str]) -> None:
    """Draw the gains of the candidates of each round. chosen: names of the effects in the model; the best one is
    labelled."""
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
