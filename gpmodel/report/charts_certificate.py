"""The picture of a certificate: how many poses have which error, before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gpmodel.arrays import Array
from gpmodel.report.picture import AFTER, AFTER_LIGHT, BEFORE, INK, MUTED, Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BINS, MOST_BINS = 12, 96
"""Bars up to the largest error after calibration, and at most up to the largest of all; half as many hide the shape."""

Heads = tuple[str, bool]
"""Heading of the errors before, and whether those after are predicted."""


def histogram(errors: Array, tolerance_mm: float | None, heads: Heads) -> Picture:
    """Draw a histogram of errors (N, 2), mm, before and after, over common bins."""
    worst = errors.max(axis=0)
    return Picture(
        "errors", "Error before and after", 5.2, 1.9,
        f"Histogram of {len(errors)} measured errors: {heads[0]} at most {worst[0]:.3f} mm, after {worst[1]:.3f} mm.",
        "", lambda figure: _draw(figure.subplots(), errors, tolerance_mm, heads),
    )  # fmt: skip


def bins_of(errors: Array, tolerance_mm: float | None) -> list[float]:
    """Edges of the bars, mm: as wide as the errors after calibration need, up to the largest error or the tolerance."""
    largest = max(float(errors.max()), tolerance_mm or 0.0, 1e-9) * 1.0001
    count = np.clip(np.ceil(BINS * largest / max(float(errors[:, 1].max()), 1e-9)), BINS, MOST_BINS)
    return [float(edge) for edge in np.linspace(0.0, largest, int(count) + 1)]


def _draw(axes: Axes, errors: Array, tolerance_mm: float | None, heads: Heads) -> None:
    from matplotlib.ticker import MaxNLocator

    bins = bins_of(errors, tolerance_mm)
    axes.hist(errors[:, 0], bins, histtype="step", color=BEFORE, lw=1.4, label=heads[0])
    after = "after, predicted" if heads[1] else "after"
    axes.hist(errors[:, 1], bins, color=AFTER_LIGHT, ec=AFTER, lw=0.6, label=after)
    if tolerance_mm is not None:
        axes.axvline(tolerance_mm, color=INK, lw=1.0, ls=(0, (3, 3)), label="tolerance")
    axes.set(xlim=(0.0, bins[-1]), xlabel="3-D error, mm", ylabel="measurements")
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4, integer=True))
    axes.legend(loc="upper right", labelcolor=MUTED)
