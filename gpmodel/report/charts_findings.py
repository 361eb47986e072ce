"""Pictures of the fitted model: basis functions of the effects, error against rank, parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gpmodel.numerics.rank import RankChoice
from gpmodel.report.picture import (
    AFTER,
    AXIS,
    BEFORE,
    MOST_VECTORS,
    MUTED,
    PAPER,
    Picture,
    broken,
    forest,
    linked,
    log_axis,
    numbers,
    signed,
)
from gpmodel.report.schema import ParameterRecord, Report
from gpmodel.report.schema_search import ShapeRecord
from gpmodel.wording import millimetres, pretty_unit, short_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_PARAMETERS = 36
"""Largest number of parameters in a picture."""
KINDS = (("parameters_angles", "Angles", "rad", 1e6, "µrad"), ("parameters_lengths", "Lengths", "m", 1e6, "µm"))
"""Name, title, unit, scale and printed unit of the pictures of parameters."""


FEWEST_RANKS = 4
"""Least number of points of a curve of error against rank."""


def pictures(report: Report) -> Iterator[Picture]:
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
