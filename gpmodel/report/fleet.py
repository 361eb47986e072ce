"""Many machines of one type in words, as text of 80 columns and as a page: pure functions of a FleetPart."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gpmodel import wording
from gpmodel.files import write_text
from gpmodel.formula.expression import ONE
from gpmodel.hierarchy.between import FEWEST, in_normal
from gpmodel.hierarchy.record import MACHINES, NOISE, BlockPart, FleetPart, Part, SharedPart
from gpmodel.numerics.interval import coverage_factor
from gpmodel.report.charts_fleet import in_words, pictures
from gpmodel.report.page import PAGE as REPORT
from gpmodel.report.page import render
from gpmodel.report.picture import numbers, rms

PAGE = "fleet.html"
NAME = 25
MOST_SAID = 3
WELL_KNOWN = 3.0
NOT_TESTED = f"Which machine stands out is not tested: that needs {FEWEST} machines"
"""Characters of a name in a table of 80 columns; outliers and effects that the verdict names; standard deviations from
zero from where a mean is one that spreads are shares of."""


def verdict(fleet: FleetPart) -> str:
    """Join the sentences of the answer."""
    return " ".join(sentences(fleet))


def sentences(fleet: FleetPart) -> list[str]:
    """State the common effects of the machines, the gain of the prior on held-out poses, and the outliers."""
    effects: list[Part] = [*(p for p in fleet.effects if not p.constant), *fleet.blocks]
    named = "; ".join(
        f"{p.name}{'' if isinstance(p, BlockPart) else f' {said(p)}'}, spread {spread(p)}" for p in effects[:MOST_SAID]
    )
    more = f"; {len(effects) - MOST_SAID} more" if len(effects) > MOST_SAID else ""
    parts = [f"{len(fleet.machines)} machines share {named}{more}" if named else f"{len(fleet.machines)} machines"]
    own, both = (rms(numbers([getattr(m, k) for m in fleet.machines])) for k in ("own_mm", "fleet_mm"))
    if own == own:
        parts.append(f"{wording.length(own)} RMS on held-out poses each by itself, {wording.length(both)} together")
    found = fleet.outliers()
    told = "; ".join(
        f"{fleet.machines[k].serial} in {p.name} (chance {wording.chance(p.chances[k])})" for k, p in found[:MOST_SAID]
    )
    rest = f" and {len(found) - MOST_SAID} more" if len(found) > MOST_SAID else ""
    further = [f"{m.serial} also has {', '.join(m.effects)}" for m in fleet.machines if m.effects]
    parts += further[:MOST_SAID]
    parts += [f"{len(further) - MOST_SAID} more have effects of their own"] if len(further) > MOST_SAID else []
    among = " in what all have" if further else ""
    if len(fleet.machines) < FEWEST:
        parts.append(NOT_TESTED)
    else:
        parts.append(f"Stands out{among}: {told}{rest}" if found else f"No machine stands out{among}")
    return [f"{part}." for part in parts]


def deviation(part: Part, machine: int) -> str:
    """State the deviation of a machine from the others, in σ of a normal distribution of equal probability."""
    return f"{wording.minus(f'{in_normal(part.z[machine], part.chances[machine]):+.1f}')} σ"


def said(part: SharedPart) -> wording.Stated:
    """Mean ± of the type."""
    return wording.measured(*in_words(part, part.mean, part.stderr), in_list=part.constant)


def spread(part: Part) -> str:
    """The spread between machines: of an effect as a share of the mean where that is well known, else in its own unit;
    of a block as a share of what its priors expect."""
    if isinstance(part, BlockPart):
        return f"{wording.percent(part.spread)} of prior"
    size = _size(part)
    if size is not None:
        return wording.percent(part.spread / size)
    return str(wording.measured(part.spread, None, part.unit, in_list=part.constant))


def band(part: Part) -> str:
    """The 95 % interval of the spread, in the unit that `spread` has it in."""
    if isinstance(part, BlockPart):
        return f"{wording.percent(part.low)} to {wording.percent(part.high)}"
    if (size := _size(part)) is not None:
        return f"{wording.percent(part.low / size)} to {wording.percent(part.high / size)}"
    listed = wording.OF_LISTS.get(part.unit) if part.constant else None
    factor, unit = listed or wording.prefix(part.spread or part.high, part.unit)
    low, high = (wording.significant(factor * value, 3) for value in (part.low, part.high))
    return f"{low} to {high} {unit}"


def _size(part: SharedPart) -> float | None:
    """Return the reference of a relative spread; None where the spread is stated in its own unit."""
    if part.name == NOISE:
        return 1.0
    return abs(part.mean) if not part.constant and abs(part.mean) > WELL_KNOWN * part.prior else None


def summary(fleet: FleetPart) -> str:
    """The verdict, the machines with the worst first, the effects, the geometry, what to distrust."""
    blocks = (
        ("Verdict", [wording.wrapped(text) for text in sentences(fleet)]),
        (machines_title(fleet), list(_machines(fleet))),
        ("Effects", list(_parameters([p for p in fleet.parameters if not p.constant]))),
        ("Effects with priors of their own", list(_blocks(fleet))),
        ("Geometry", list(_parameters([p for p in fleet.parameters if p.constant]))),
        ("Record", [wording.wrapped(text) for text in record_of(fleet)]),
    )
    return wording.titled(blocks)


def record_of(fleet: FleetPart) -> Iterator[str]:
    """Where the numbers are from, and what they cannot say."""
    yield f"effects {fleet.chosen}"
    factor = coverage_factor(len(fleet.machines) - 1)
    yield f"± σ of a mean: standard uncertainty (k = 1); ± {factor:.2f} σ is its 95 % interval, k by Student's t"
    geometry = [p for p in fleet.prior if all(term.basis == str(ONE) for term in p.terms)]
    known = [[p.deviation for p in geometry if p.unit == unit] for unit in ("m", "rad")]
    within = [
        str(wording.measured(float(np.median(d)), None, u)) for d, u in zip(known, ("m", "rad"), strict=True) if d
    ]
    yield f"a further machine is believed to be like the type within {' and '.join(within)} of geometry, median"
    if fleet.left_out:
        yield f"not listed, because not every machine's poses tell them from the others: {', '.join(fleet.left_out)}"
    if len(fleet.machines) < FEWEST:
        yield NOT_TESTED


def machines_title(fleet: FleetPart) -> str:
    """The heading of the table of machines, with its order where there is one."""
    return "Machines" + (", the farthest from the others first" if len(fleet.machines) >= FEWEST else "")


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
        yield f"    {wording.shortened(part.name, NAME - 1):<{NAME}}{cells} spread {spread(part)}"


def _blocks(fleet: FleetPart) -> Iterator[str]:
    for part in fleet.blocks:
        yield f"    {wording.shortened(part.name, 34):<35}{len(part.effects):>3} spread {spread(part)}, {band(part)}"


def html(fleet: FleetPart, drawings: dict[str, str]) -> str:
    """The page's text. drawings: inline SVG of the pictures by name."""
    return render(
        "fleet.html.j2", fleet=fleet, verdict=sentences(fleet), said=said, spread=spread, band=band,
        deviation=deviation, page=f"{MACHINES}/{{}}/{REPORT}",
        record=list(record_of(fleet)), enough=len(fleet.machines) >= FEWEST, drawings=drawings,
        pictures=list(pictures(fleet)),
    )  # fmt: skip


def write_pages(fleet: FleetPart, folder: Path) -> None:
    """Write fleet.html and figures/ in `folder`."""
    from gpmodel.report.figures import drawn

    write_text(folder / PAGE, html(fleet, drawn(pictures(fleet), folder)))
