"""Pictures of many machines of one type: a parameter over the machines, and every machine in every parameter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gpmodel import wording
from gpmodel.hierarchy.record import NOISE, FleetPart, SharedPart
from gpmodel.report.picture import AFTER, AFTER_LIGHT, AXIS, BEFORE, INK, MUTED, NULL, PAPER, Picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS = 9
"""Parameters drawn one by one, three in a row; the map has all of them."""
MOST_MACHINES = 60
"""Columns of the map that can still be told apart, and names along an axis."""


def pictures(fleet: FleetPart) -> Iterator[Picture]:
    """The map of every machine in every parameter, then the parameters that say most, one by one."""
    count = len(fleet.machines)
    if count <= MOST_MACHINES:
        yield Picture(
            "standing", "Every machine in every parameter", 9.8, 0.9 + 0.2 * len(fleet.parts),
            f"Distance of each of {count} machines from the others in each of {len(fleet.parts)} parameters.",
            "Area: how far a machine is from the others, in their spread and its own ±; hollow below the mean, full "
            "above. Coloured: beyond chance. Machines in the order of the table.",
            partial(_map, fleet=fleet),
        )  # fmt: skip
    for number, part in enumerate(_shown(fleet), 1):
        mean = wording.measured(*in_words(part, part.mean, part.stderr))
        yield Picture(
            f"parameter_{number}", part.name, 3.25, 2.5,
            f"{part.name} of each machine with its deviation; mean of the type {mean}.",
            "", partial(_panel, part=part, order=fleet.worst_first()),
        )  # fmt: skip


def in_words(part: SharedPart, value: float, deviation: float) -> tuple[float, float, str]:
    """A value of a parameter with its deviation and unit; of the noise in metres."""
    size = float(np.exp(value)) if part.name == NOISE else value
    return (size, size * deviation, "m") if part.name == NOISE else (value, deviation, part.unit)


def _shown(fleet: FleetPart) -> list[SharedPart]:
    """What is no geometry, what somebody stands out in, then the geometry with the farthest machines."""
    first = [p for p in fleet.parameters if not p.constant or p.outliers]
    rest = sorted((p for p in fleet.parameters if p not in first), key=lambda p: -np.abs(p.z).max())
    return (sorted(first, key=lambda p: not p.outliers) + rest)[:PANELS]


def _panel(figure: Figure, part: SharedPart, order: Sequence[int]) -> None:
    axes = figure.subplots()
    factor, unit = wording.prefix(*_scale(part))
    at = np.arange(len(order))
    own = _drawn(part, part.values, part.stderrs, factor)
    low, middle, high = (factor * in_words(part, part.mean + k * part.spread, 0.0)[0] for k in (-1, 0, 1))
    axes.axhspan(low, high, color=AXIS, alpha=0.35, lw=0)
    axes.axhline(middle, color=MUTED, lw=1)
    for outside, colour in ((False, AFTER), (True, NULL)):
        rows = [i for i, k in enumerate(order) if (k in part.outliers) == outside]
        chosen = np.array(order, dtype=int)[rows]
        axes.errorbar(at[rows], own[0][chosen], own[1][chosen], fmt="o", color=colour, ms=3.5, lw=1.2)
    if part.shrunken:
        both = _drawn(part, part.shrunken, part.shrunken_stderrs, factor)[0]
        axes.plot(at, both[np.array(order)], "_", color=INK, ms=6, mew=1.0, zorder=4)
    axes.set_xlim(-0.7, len(order) - 0.3)
    axes.set_xticks([])
    axes.set_ylabel(unit)
    axes.grid(axis="y")


def _scale(part: SharedPart) -> tuple[float, str]:
    largest = max(part.values) if part.name == NOISE else max(part.values, key=abs)
    value, _, unit = in_words(part, largest, 0.0)
    return abs(value), unit


def _drawn(part: SharedPart, values: Sequence[float], stderrs: Sequence[float], factor: float) -> np.ndarray:
    """Values and deviations (2, m) in the unit of the axis."""
    return factor * np.array([in_words(part, v, e)[:2] for v, e in zip(values, stderrs, strict=True)]).T


def _map(figure: Figure, fleet: FleetPart) -> None:
    axes = figure.subplots()
    order = fleet.worst_first()
    for row, part in enumerate(fleet.parts):
        for column, k in enumerate(order):
            z = part.z[k]
            colour = NULL if k in part.outliers else AFTER_LIGHT if z > 0 else BEFORE
            axes.plot(column, row, "o", ms=min(1.5 + 2.0 * abs(z), 11.0), mec=colour, mew=1.1, alpha=0.9,
                      mfc=colour if z > 0 else PAPER)  # fmt: skip
    axes.set_yticks(range(len(fleet.parts)), [wording.shortened(p.name, 34) for p in fleet.parts])
    serials = [wording.shortened(fleet.machines[k].serial, 14) for k in order]
    axes.set_xticks(
        range(len(order)), serials, rotation=45 if len(order) > 8 else 0, ha="left" if len(order) > 8 else "center"
    )
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.tick_params(axis="y", labelcolor=INK)
    axes.set_ylim(len(fleet.parts) - 0.4, -0.6)
    axes.set_xlim(-0.6, len(order) - 0.4)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.grid(lw=0.5)
