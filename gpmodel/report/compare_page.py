"""compare.html: the changes between two calibrations as a page."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from gpmodel.report.compare import SIDES, Comparison, cells, tables, verdict
from gpmodel.report.figures import drawn
from gpmodel.report.page import render
from gpmodel.report.picture import Picture, forest
from gpmodel.wording import minus, short_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gpmodel.report.compare import Change


MOST = 40
"""Largest number of changes in a picture; the largest changes are shown."""


def picture(changes: Sequence[Change]) -> Picture | None:
    """Return a picture of the changes in units of their σ, which makes lengths and angles
    comparable; None without σ."""
    known = sorted((c for c in changes if c.stderr), key=lambda c: -c.z)[:MOST]
    if not known:
        return None
    largest = ", ".join(f"{c.name} {minus(f'{c.in_deviations:+.1f}')} σ" for c in known[:4])
    return Picture(
        "changes", "Changes in units of σ", 5.6, 0.6 + 0.19 * len(known), f"Changes in units of σ: {largest}.",
        ("Change ± σ, in units of σ. Filled: significant, corrected for the number of "
        "comparisons."), partial(_draw, changes=known),
    )  # fmt: skip


def _draw(figure: Figure, changes: Sequence[Change]) -> None:
    rows = [(short_name(c.name, 34), c.in_deviations, 1.0, c.significant) for c in changes]
    forest(figure.subplots(), rows, "change ± σ, in σ")


def html(found: Comparison) -> str:
    """Return the comparison as a page."""
    chart = picture([c for _, changes in tables(found) for c in changes])
    return render(
        "compare.html.j2", found=found, verdict=verdict(found), cells=cells, tables=tables(found), sides=SIDES,
        picture=chart, drawing=drawn([chart])[chart.name] if chart else "",
    )  # fmt: skip
