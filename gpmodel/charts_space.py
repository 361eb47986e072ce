"""Pictures of the residual as arrows in the workspace, from three sides."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from gpmodel.picture import AFTER, BEFORE, INK, MUTED, Array, Picture, Report, nice_length, numbers
from gpmodel.wording import minus

VIEWS = (("above", 0, 1), ("side", 0, 2), ("front", 1, 2))
SHARE_OF_SPAN = 0.13
ARROWS = 250
"""At most this many poses are drawn, evenly chosen along the rows."""


def pictures(report: Report) -> Iterator[Picture]:
    """Arrows seen from above, from the side and from the front, one scale for the three."""
    plots = report.get("plots") or {}
    residual = plots.get("residual_mm") or {}
    points, after = numbers(plots.get("points_mm")), numbers(residual.get("final"))
    if len(points) == 0 or points.shape != after.shape:
        return
    before = numbers(residual.get("standard")) if report.get("effects") else after
    whole = np.isfinite(points).all(axis=1) & np.isfinite(after).all(axis=1) & np.isfinite(before).all(axis=1)
    chosen = np.flatnonzero(whole)
    chosen = chosen[:: max(1, -(-len(chosen) // ARROWS))]
    if len(chosen) == 0:
        return
    points, before, after = points[chosen], before[chosen], after[chosen]
    typical = float(np.percentile(np.linalg.norm(before, axis=1), 90))
    span = float(np.ptp(points, axis=0).max())
    magnification = SHARE_OF_SPAN * (span or 1.0) / (typical or 1.0)
    key = nice_length(0.16 * (span or 1.0) / magnification)
    some = "" if len(chosen) == whole.sum() else f" {len(chosen)} of {int(whole.sum())} poses are shown."
    models = "standard model (grey) and of the final model (blue)" if report.get("effects") else "standard model"
    colours = "Grey before, blue after. " if report.get("effects") else ""
    for name, i, j in VIEWS:
        yield Picture(
            f"arrows_{name}", f"Seen from {'the ' if name != 'above' else ''}{name}", 3.6, 3.5,
            f"Residual of the {models} as arrows at the nominal positions, {'xyz'[i]} and {'xyz'[j]} of the root frame.",
            f"{colours}Residual {float(f'{magnification:.2g}'):,.0f} times enlarged.{some}",
            partial(_arrows, points=points, before=before if report.get("effects") else None, after=after, plane=(i, j),
                    magnification=magnification, key=key),
        )  # fmt: skip


def _arrows(
    figure: Any,
    points: Array,
    before: Array | None,
    after: Array,
    plane: tuple[int, int],
    magnification: float,
    key: float,
) -> None:
    axes = figure.subplots()
    i, j = plane
    span = float(np.ptp(points, axis=0).max()) or 1.0
    axes.scatter(points[:, i], points[:, j], s=3, color="#b9c0c9", lw=0)
    for residual, colour in ((before, BEFORE), (after, AFTER)):
        if residual is not None:
            axes.quiver(points[:, i], points[:, j], residual[:, i], residual[:, j], color=colour, angles="xy",
                        scale_units="xy", scale=1.0 / magnification, width=0.006, headwidth=3.6, headlength=4.0,
                        headaxislength=3.6)  # fmt: skip
    middle = points.min(axis=0) / 2 + points.max(axis=0) / 2
    half = 0.62 * span
    axes.set_xlim(middle[i] - half, middle[i] + half)
    axes.set_ylim(middle[j] - half, middle[j] + half)
    left, low = middle[i] - 0.58 * span, middle[j] - 0.58 * span
    axes.plot([left, left + key * magnification], [low, low], color=INK, lw=2.2, solid_capstyle="butt")
    axes.text(left, low + 0.02 * span, f"{key:g} mm", color=INK, fontsize=8.5, va="bottom")
    axes.set_aspect("equal")
    axes.set(xlabel=f"{'xyz'[i]}, mm", ylabel=f"{'xyz'[j]}, mm")
    for which in (axes.xaxis, axes.yaxis):
        which.get_major_locator().set_params(nbins=5)
        which.set_major_formatter(lambda v, _: minus(f"{v:g}"))
    axes.tick_params(labelcolor=MUTED)
    axes.grid(axis="both")
