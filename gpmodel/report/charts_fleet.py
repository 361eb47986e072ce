"""Pictures of many machines of one type: a parameter over the machines, and every machine in every parameter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gpmodel import wording
from gpmodel.hierarchy.between import in_normal
from gpmodel.hierarchy.record import NOISE, FleetPart, SharedPart
from gpmodel.report.picture import AFTER, AFTER_LIGHT, AXIS, BEFORE, INK, MUTED, NULL, PAPER, Picture, log_axis, numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS = 9
"""Parameters drawn one by one, three in a row; the map has all of them."""
MOST_MACHINES = 60
"""Columns of the map that can still be told apart."""
MOST_NAMES = 20
"""Along an axis."""


def pictures(fleet: FleetPart) -> Iterator[Picture]:
    """Errors of every machine; the map of every machine in every parameter where one stands out; single parameters."""
    count = len(fleet.machines)
    if all(m.standard_mm and m.own_mm and m.fleet_mm for m in fleet.machines):
        yield Picture(
            "machines", "Before and after of each machine", 9.8, 3.0,
            f"Errors of each of {count} machines on held-out poses: standard model, alone, together.",
            "3-D RMS on poses held out, machines in the order of the table.", partial(_errors, fleet=fleet),
        )  # fmt: skip
    if count <= MOST_MACHINES and fleet.outliers():
        yield Picture(
            "standing", "Every machine in every parameter", 9.8, 0.9 + 0.2 * len(fleet.parts),
            f"Distance of each of {count} machines from the others in each of {len(fleet.parts)} parameters.",
            "Area: how far a machine is from the others, in σ of a normal law as improbable; hollow below the mean, "
            "full above. Coloured: beyond chance. Machines in the order of the table.",
            partial(_map, fleet=fleet),
        )  # fmt: skip
    for number, part in enumerate(_shown(fleet), 1):
        mean = wording.measured(*in_words(part, part.mean, part.stderr))
        yield Picture(
            f"parameter_{number}", part.name, 3.25, 2.5,
            f"{part.name} of each machine with its deviation; mean of the type {mean}.",
            "", partial(_panel, part=part, fleet=fleet),
        )  # fmt: skip


def in_words(part: SharedPart, value: float, deviation: float) -> tuple[float, float, str]:
    """A value of a parameter with its deviation and unit; of the noise in metres."""
    size = float(np.exp(value)) if part.name == NOISE else value
    return (size, size * deviation, "m") if part.name == NOISE else (value, deviation, part.unit)


def _shown(fleet: FleetPart) -> list[SharedPart]:
    """Select the shown parameters: effects beyond geometry, parameters with outliers, then geometry with the
    farthest machines.
    """
    first = [p for p in fleet.parameters if not p.constant or p.outliers]
    rest = sorted((p for p in fleet.parameters if p not in first), key=lambda p: -np.abs(p.z).max())
    return (sorted(first, key=lambda p: not p.outliers) + rest)[:PANELS]


def _panel(figure: Figure, part: SharedPart, fleet: FleetPart) -> None:
    axes, order = figure.subplots(), fleet.worst_first()
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
    _name(axes, [fleet.machines[k].serial for k in order])
    axes.set_ylabel(unit)
    axes.grid(axis="y")


def _errors(figure: Figure, fleet: FleetPart) -> None:
    axes, order = figure.subplots(), fleet.worst_first()
    machines = [fleet.machines[k] for k in order]
    of = {"standard model": "standard_mm", "its own poses alone": "own_mm", "with the type": "fleet_mm"}
    errors = np.array([numbers([getattr(m, field) for m in machines]) for field in of.values()])
    for name, own, colour, marker in zip(of, errors, (BEFORE, AFTER_LIGHT, AFTER), "so^", strict=True):
        axes.plot(own, marker, color=colour, ms=4, label=name)
    if known := errors[errors > 0].tolist():
        log_axis(axes, 0.8 * min(known), 1.25 * max(known), "y")
    axes.set_ylabel("RMS held out, mm")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    _name(axes, [m.serial for m in machines])
    axes.grid(axis="y")


def _name(axes: Axes, serials: Sequence[str]) -> None:
    """Machines along the axis by name, upright where they are many, and every so many where they would overlap."""
    every = -(-len(serials) // MOST_NAMES)
    shown = [wording.shortened(serial, 14) for serial in serials[::every]]
    axes.set_xticks(range(0, len(serials), every), shown, rotation=90 if len(shown) > 3 else 0)


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
            z = in_normal(part.z[k], part.chances[k])
            colour = NULL if k in part.outliers else AFTER_LIGHT if z > 0 else BEFORE
            axes.plot(column, row, "o", ms=min(1.5 + 2.0 * abs(z), 11.0), mec=colour, mew=1.1, alpha=0.9,
                      mfc=colour if z > 0 else PAPER)  # fmt: skip
    axes.set_yticks(range(len(fleet.parts)), [wording.shortened(p.name, 34) for p in fleet.parts])
    _name(axes, [fleet.machines[k].serial for k in order])
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.tick_params(axis="y", labelcolor=INK)
    axes.set_ylim(len(fleet.parts) - 0.4, -0.6)
    axes.set_xlim(-0.6, len(order) - 0.4)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.grid(lw=0.5)
