"""Define a picture of a report: name, size, description in words, and drawing function."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.arrays import Array
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.wording import minus

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.collections import Collection
    from matplotlib.figure import Figure

INK, MUTED, RULE, AXIS, PAPER = "#1d2733", "#5d6875", "#e3e7ec", "#b9c0c9", "#ffffff"
BEFORE, AFTER, AFTER_LIGHT, NULL = "#868d98", "#1c5d99", "#5b93c7", "#c2700f"
"""Colours of pictures. Data have a contrast of at least 3 with the paper, text 4.5 (WCAG 2 AA)."""

EXPLORE = "explore.html"
CLIP = 3.0
"""End of a picture's axis, relative to the 98th percentile of the values. Values beyond are marked at the axis end."""

MOST_VECTORS = 1500
"""Number of poses from which dots are drawn as pixels; vector graphics of more dots would need megabytes."""

GAP, FEW = 0.1, 9
"""Largest gap of a curve through measured poses, relative to its width; least number of poses for gaps."""


@dataclass(frozen=True)
class Picture:
    """A picture (chart) of a report.

    width, height: size of the picture, inches.
    alt: one sentence for readers who cannot see the picture.
    caption: how to read the picture.
    draw: function that draws the picture into an empty matplotlib Figure.
    """

    name: str
    title: str
    width: float
    height: float
    alt: str
    caption: str
    draw: Callable[[Figure], None]


def numbers(values: Sequence[float | None] | Sequence[Sequence[float | None]]) -> Array:
    """Return a list of numbers as floats, with NaN for None."""
    return np.array(values, dtype=float)


def broken(x: Array, y: Array) -> tuple[Array, Array]:
    """Return a line through points, x ascending, with NaN at gaps wider than GAP; without gaps for at most FEW values
    of x."""
    widest = GAP * np.ptp(x) if len(np.unique(x)) > FEW else np.inf
    wide = np.flatnonzero(np.diff(x) > widest) + 1
    return np.insert(x, wide, np.nan), np.insert(y, wide, np.nan)


def rms(values: Array) -> float:
    """Return the RMS of the finite values; NaN without a finite value."""
    return root_mean_square(values[np.isfinite(values)])


def log_ticks(low: float, high: float) -> list[float]:
    """Return ticks of a logarithmic axis at 1, 2, 5 per decade, or at whole decades if ticks would overlap."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = (1, 2, 5) if math.log10(high / low) < 2.6 else (1,)
    return [t for t in (s * 10.0**d for d in decades for s in steps) if low <= t <= high]


def log_axis(axes: Axes, low: float, high: float, which: str = "x") -> None:
    """Make an axis of a picture logarithmic from `low` to `high`, with plain numbers."""
    ticks = log_ticks(low, high)
    getattr(axes, f"set_{which}scale")("log")
    getattr(axes, f"set_{which}lim")(low, high)
    getattr(axes, f"set_{which}ticks")(ticks, [f"{t:g}" for t in ticks])
    getattr(axes, f"set_{which}ticks")([], minor=True)


def rows_only(axes: Axes, count: int, above: float = 0.75) -> None:
    """Draw `count` horizontal rows, the first on top, without a vertical scale."""
    axes.set_ylim(count - 0.5, -above)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.grid(axis="x")


def named_rows(axes: Axes, names: Sequence[str]) -> None:
    """Draw one horizontal row per name, the first on top."""
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.grid(axis="x")


def forest(axes: Axes, rows: Sequence[tuple[str, float, float, bool]], label: str) -> None:
    """Draw values ± standard errors, one per named row, with filled symbols for significant values.
    rows: name, value, standard error, True if significant. label: label of the axis."""
    named_rows(axes, [name for name, *_ in rows])
    axes.axvline(0, color=AXIS, lw=1)
    for row, (_, value, deviation, clear) in enumerate(rows):
        colour = AFTER if clear else BEFORE
        axes.plot([value - deviation, value + deviation], [row, row], color=colour, lw=1.6)
        axes.plot(value, row, "o", mfc=colour if clear else PAPER, mec=colour, ms=4.5)
    axes.tick_params(axis="y", labelsize=8)
    signed(axes.xaxis)
    axes.set_xlabel(label)


def signed(*axes: Axis) -> None:
    """Format the numbers of axes with a true minus sign."""
    for axis in axes:
        axis.set_major_formatter(lambda v, _: minus(f"{v:g}"))


def noise_floor(axes: Axes, floor: float, colour: str = MUTED, *, said: bool = True) -> None:
    """Draw a dashed line at the noise floor, behind all other elements. said: whether to label the dashed line."""
    axes.axvline(floor, color=colour, lw=1, ls=(0, (3, 3)), zorder=0)
    if said:
        axes.annotate("noise floor", (floor, 1.0), (3, 0), xycoords=("data", "axes fraction"),
                      textcoords="offset points", fontsize=8, color=MUTED, va="top")  # fmt: skip


def linked(dots: Collection, rows: Sequence[int], many: bool) -> None:
    """Link each dot of a picture to its pose in explore.html, unless dots are drawn as pixels (`many`)."""
    if not many:
        dots.set_urls([f"{EXPLORE}#row={row}" for row in rows])


def nice_length(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that does not exceed `length`."""
    power = 10.0 ** math.floor(math.log10(length))
    return float(max(s * power for s in (1, 2, 5) if s * power <= length * (1 + 1e-9)))
