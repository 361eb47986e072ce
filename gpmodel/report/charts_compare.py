"""The picture of a comparison: every change with its standard deviation."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from gpmodel.report.picture import AFTER, AXIS, BEFORE, PAPER, Picture
from gpmodel.wording import minus, short_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gpmodel.report.compare import Change

MOST = 40
"""Changes of a picture that can still be read, the largest."""


def picture(changes: Sequence[Change]) -> Picture | None:
    """The changes in their own σ, which makes lengths and angles comparable; None where they have none."""
    known = sorted((c for c in changes if c.stderr), key=lambda c: -c.z)[:MOST]
    if not known:
        return None
    largest = ", ".join(f"{c.name} {minus(f'{c.in_deviations:+.1f}')} σ" for c in known[:4])
    return Picture(
        "changes", "Changes in their own σ", 5.6, 0.6 + 0.19 * len(known), f"Changes in their own σ: {largest}.",
        "Change ± σ, over σ. Filled: beyond chance, however many are compared.", partial(_draw, changes=known),
    )  # fmt: skip


def _draw(figure: Figure, changes: Sequence[Change]) -> None:
    axes = figure.subplots()
    axes.set_ylim(len(changes) - 0.4, -0.6)
    axes.axvline(0, color=AXIS, lw=1)
    for row, change in enumerate(changes):
        z, colour = change.in_deviations, AFTER if change.significant else BEFORE
        axes.plot([z - 1, z + 1], [row, row], color=colour, lw=1.6)
        axes.plot(z, row, "o", mfc=colour if change.significant else PAPER, mec=colour, ms=4.5)
    axes.set_yticks(range(len(changes)), [short_name(c.name, 34) for c in changes])
    axes.tick_params(axis="y", length=0, labelsize=8)
    axes.spines["left"].set_visible(False)
    axes.xaxis.set_major_formatter(lambda v, _: minus(f"{v:g}"))
    axes.set_xlabel("change ± σ, in σ")
    axes.grid(axis="x")
