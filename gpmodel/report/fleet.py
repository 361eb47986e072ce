"""Report on several machines of one type, as text of 80 columns and as a page, made from a FleetPart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gpmodel import wording
from gpmodel.files import write_text
from gpmodel.formula.expression import ONE
from gpmodel.hierarchy.between import FEWEST, normal_score
from gpmodel.hierarchy.record import MACHINES, NOISE, BlockPart, FleetPart, Part, SharedPart
from gpmodel.numerics.interval import coverage_factor
from gpmodel.report.page import PAGE as REPORT
from gpmodel.report.page import render
from gpmodel.report.picture import (
    AFTER,
    AFTER_LIGHT,
    AXIS,
    BEFORE,
    INK,
    MUTED,
    NULL,
    PAPER,
    Picture,
    log_axis,
    numbers,
    rms,
)
from gpmodel.report.words import fitted_loads

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANELS = 9
"""Largest number of parameters with a separate figure, three figures in a row of the page."""
MOST_MACHINES = 60
"""Largest number of machines in the figure of the deviation of every machine in every parameter."""
MOST_NAMES = 20
"""Largest number of names along an axis of a picture."""


def pictures(fleet: FleetPart) -> Iterator[Picture]:
    """Yield figures of several machines: errors, deviations in all parameters, and values of single parameters."""
    count = len(fleet.machines)
    if all(m.standard_mm and m.own_mm and m.fleet_mm for m in fleet.machines):
        yield Picture(
            "machines", "Errors of each machine", 9.8, 3.0,
            (f"Errors of each of {count} machines on held-out poses: standard model, own poses alone, with the "
            "prior of the type."),
            "3-D RMS on held-out poses. The machines are in the order of the table.", partial(_errors, fleet=fleet),
        )  # fmt: skip
    if count <= MOST_MACHINES and fleet.outliers():
        yield Picture(
            "standing", "Every machine in every parameter", 9.8, 0.9 + 0.2 * len(fleet.parts),
            f"Distance of each of {count} machines from the others in each of {len(fleet.parts)} parameters.",
            "Area: deviation of a machine from the others, in σ of a normal distribution with equal probability. "
            "Hollow: below "
            "the mean; filled: above. Orange: significant. The machines are in the order of the table.",
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
    """Return the value of a parameter with its deviation and unit; the parameter for noise is a logarithm, returned in
    metres."""
    size = float(np.exp(value)) if part.name == NOISE else value
    return (size, size * deviation, "m") if part.name == NOISE else (value, deviation, part.unit)


def _shown(fleet: FleetPart) -> list[SharedPart]:
    """Return the parameters to draw: effects, parameters with outlying machines, geometry of outlying machines."""
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
    """Label the machines along an axis; many labels are upright, and overlapping labels are omitted."""
    every = -(-len(serials) // MOST_NAMES)
    shown = [wording.shortened(serial, 14) for serial in serials[::every]]
    axes.set_xticks(range(0, len(serials), every), shown, rotation=90 if len(shown) > 3 else 0)


def _scale(part: SharedPart) -> tuple[float, str]:
    largest = max(part.values) if part.name == NOISE else max(part.values, key=abs)
    value, _, unit = in_words(part, largest, 0.0)
    return abs(value), unit


def _drawn(part: SharedPart, values: Sequence[float], stderrs: Sequence[float], factor: float) -> np.ndarray:
    """Return values of a parameter on all machines, and their standard errors, in the unit of the axis."""
    return factor * np.array([in_words(part, v, e)[:2] for v, e in zip(values, stderrs, strict=True)]).T


def _map(figure: Figure, fleet: FleetPart) -> None:
    axes = figure.subplots()
    order = fleet.worst_first()
    for row, part in enumerate(fleet.parts):
        for column, k in enumerate(order):
            z = normal_score(part.z[k], part.chances[k])
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


PAGE = "fleet.html"
MOST_SAID = 3
WELL_KNOWN = 3.0
NOT_TESTED = f"Outliers are not tested: the test needs {FEWEST} machines"
"""Number of outlying machines and effects that the verdict names; ratio of a mean to its prior standard deviation above
which spreads are stated relative to the mean."""


def verdict(fleet: FleetPart) -> str:
    """Return the verdict on the machines as one text."""
    return " ".join(sentences(fleet))


def sentences(fleet: FleetPart) -> list[str]:
    """State the common effects of the machines, the gain by the prior on held-out poses, and the outliers."""
    effects: list[Part] = [*(p for p in fleet.effects if not p.constant), *fleet.blocks]
    named = "; ".join(
        f"{p.name}{'' if isinstance(p, BlockPart) else f' {said(p)}'}, spread {spread(p)}" for p in effects[:MOST_SAID]
    )
    more = f"; {len(effects) - MOST_SAID} more" if len(effects) > MOST_SAID else ""
    parts = [f"{len(fleet.machines)} machines share {named}{more}" if named else f"{len(fleet.machines)} machines"]
    own, both = (rms(numbers([getattr(m, k) for m in fleet.machines])) for k in ("own_mm", "fleet_mm"))
    if own == own:
        parts.append(
            f"{wording.length(own)} RMS on held-out poses with own poses alone, {wording.length(both)} with the "
            "prior of the type"
        )
    found = fleet.outliers()
    told = "; ".join(
        f"{fleet.machines[k].serial} in {p.name} (chance {wording.chance(p.chances[k])})" for k, p in found[:MOST_SAID]
    )
    rest = f" and {len(found) - MOST_SAID} more" if len(found) > MOST_SAID else ""
    further = [f"{m.serial} also has {', '.join(m.effects)}" for m in fleet.machines if m.effects]
    parts += further[:MOST_SAID]
    parts += [f"{len(further) - MOST_SAID} more machines have further effects"] if len(further) > MOST_SAID else []
    parts += [f"{m.serial}: {fitted_loads(m.loads).rstrip('.')}" for m in fleet.machines if m.loads][:MOST_SAID]
    among = " in the common effects" if further else ""
    if len(fleet.machines) < FEWEST:
        parts.append(NOT_TESTED)
    else:
        parts.append(f"Outlier{among}: {told}{rest}" if found else f"No machine is an outlier{among}")
    return [f"{part}." for part in parts]


def deviation(part: Part, machine: int) -> str:
    """State the deviation of a machine from the others, in σ of a normal distribution of equal probability."""
    value = normal_score(part.z[machine], part.chances[machine])
    return f"{wording.minus(f'{value:+.1f}') if abs(value) >= 0.05 else '0.0'} σ"


def said(part: SharedPart) -> wording.Stated:
    """Return the mean of a parameter over all machines of the type, with its standard error."""
    return wording.measured(*in_words(part, part.mean, part.stderr), in_list=part.constant)


def spread(part: Part) -> str:
    """State the spread of a parameter between machines: relative to a well known mean, otherwise in its unit.
    The spread of a block of effects is stated relative to the priors of the block."""
    if isinstance(part, BlockPart):
        return f"{wording.percent(part.spread)} of prior"
    size = _size(part)
    if size is not None:
        return wording.percent(part.spread / size)
    return str(wording.measured(part.spread, None, part.unit, in_list=part.constant))


def band(part: Part) -> str:
    """State the 95 % interval of the spread of a parameter between machines, in the unit of `spread`."""
    if isinstance(part, BlockPart):
        return f"{wording.percent(part.low)} to {wording.percent(part.high)}"
    if (size := _size(part)) is not None:
        return f"{wording.percent(part.low / size)} to {wording.percent(part.high / size)}"
    listed = wording.OF_LISTS.get(part.unit) if part.constant else None
    factor, unit = listed or wording.prefix(part.spread or part.high, part.unit)
    low, high = (wording.significant(factor * value, 3) for value in (part.low, part.high))
    return f"{low} to {high} {unit}"


def _size(part: SharedPart) -> float | None:
    """Return the reference value of a relative spread; None if a spread is stated in the parameter's unit."""
    if part.name == NOISE:
        return 1.0
    return abs(part.mean) if not part.constant and abs(part.mean) > WELL_KNOWN * part.prior else None


def summary(fleet: FleetPart) -> str:
    """Return the report on several machines as text: verdict, machines (the worst first), effects, geometry, record."""
    blocks = (
        ("Verdict", [wording.wrapped(text) for text in sentences(fleet)]),
        (f"Machines{', the largest deviation first' * (len(fleet.machines) >= FEWEST)}", list(_machines(fleet))),
        ("Effects", list(_parameters([p for p in fleet.parameters if not p.constant]))),
        ("Effects with priors of their own", list(_blocks(fleet))),
        ("Geometry", list(_parameters([p for p in fleet.parameters if p.constant]))),
        ("Record", [wording.wrapped(text) for text in record_of(fleet)]),
    )
    return wording.titled(blocks)


def record_of(fleet: FleetPart) -> Iterator[str]:
    """Yield sentences on the origin and the limits of the numbers on several machines."""
    yield f"effects {fleet.chosen}"
    factor = coverage_factor(len(fleet.machines) - 1)
    yield f"± σ of a mean: standard uncertainty (k = 1); ± {factor:.2f} σ is the 95 % interval (k from Student's t)"
    geometry = [p for p in fleet.prior if all(term.basis == str(ONE) for term in p.terms)]
    known = [[p.deviation for p in geometry if p.unit == unit] for unit in ("m", "rad")]
    within = [
        str(wording.measured(float(np.median(d)), None, u)) for d, u in zip(known, ("m", "rad"), strict=True) if d
    ]
    yield f"prior of a further machine: its geometry deviates from the type by {' and '.join(within)} (median σ)"
    if fleet.left_out:
        yield f"not listed, because the poses of some machines do not determine them: {', '.join(fleet.left_out)}"
    if len(fleet.machines) < FEWEST:
        yield NOT_TESTED


def _machines(fleet: FleetPart) -> Iterator[str]:
    far = "   farthest in" if len(fleet.machines) >= FEWEST else ""
    yield f"    {'':12}{'':6}{'noise':>7}{'RMS held out, mm':>26}{far}"
    yield f"    {'':12}{'poses':>6}{'mm':>7}{'standard':>9}{'alone':>8}{'together':>9}"
    for k in fleet.worst_first():
        machine, part = fleet.machines[k], fleet.worst(k)
        values = ((machine.sigma_mm, 7), (machine.standard_mm, 9), (machine.own_mm, 8), (machine.fleet_mm, 9))
        cells = "".join(f"{wording.millimetres(value):>{width}}" for value, width in values)
        mark = "*" if k in part.outliers else ""
        farthest = f"   {wording.shortened(part.name, 17):<18}{deviation(part, k)}{mark}"
        row = f"    {wording.shortened(machine.serial, 11):<12}{machine.poses:>6}{cells}"
        yield row + (farthest if far else "")
        if machine.effects:
            yield wording.wrapped(f"in addition: {', '.join(machine.effects)}", 6)


def _parameters(parts: list[SharedPart]) -> Iterator[str]:
    for part in parts:
        value = said(part)
        cells = f"{value.value:>10} ± {value.deviation or wording.UNKNOWN:<8}{value.unit:<11}"
        yield f"    {wording.shortened(part.name, wording.NAME):<{wording.NAME + 1}}{cells} spread {spread(part)}"


def _blocks(fleet: FleetPart) -> Iterator[str]:
    for part in fleet.blocks:
        yield f"    {wording.shortened(part.name, 34):<35}{len(part.effects):>3} spread {spread(part)}, {band(part)}"


def html(fleet: FleetPart, drawings: dict[str, str]) -> str:
    """Return the page on several machines as HTML. drawings: inline SVG of the pictures by name."""
    return render(
        "fleet.html.j2", fleet=fleet, verdict=sentences(fleet), said=said, spread=spread, band=band,
        deviation=deviation, page=f"{MACHINES}/{{}}/{REPORT}",
        record=list(record_of(fleet)), enough=len(fleet.machines) >= FEWEST, drawings=drawings,
        pictures=list(pictures(fleet)),
    )  # fmt: skip


def write_pages(fleet: FleetPart, folder: Path) -> None:
    """Write the page fleet.html and its pictures figures/ in `folder`."""
    from gpmodel.report.figures import drawn

    write_text(folder / PAGE, html(fleet, drawn(pictures(fleet), folder)))
