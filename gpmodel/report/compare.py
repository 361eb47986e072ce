"""List changes between two calibrations of a machine, as text and as a page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from gpmodel import wording
from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import same_machine
from gpmodel.model.sites import table_names, translate
from gpmodel.numerics.interval import SIGNIFICANCE, freedom_of_sum, holm
from gpmodel.report.picture import Picture, forest
from gpmodel.report.schema import MechanismRecord, ParameterRecord, Report
from gpmodel.report.schema_search import EffectRecord

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Record = ParameterRecord | EffectRecord


@dataclass(frozen=True)
class Change:
    """A parameter in a first report (before) and in a second report (after) on one machine.

    before, after: value and standard error, SI units.
    stderr: standard error of the difference, None if both reports use equal rows.
    chance: probability of so large a difference without a change, corrected for all comparisons (Holm).
    """

    name: str
    unit: str
    before: tuple[float, float]
    after: tuple[float, float]
    stderr: float | None
    chance: float = 1.0

    @property
    def difference(self) -> float:
        """Value of the parameter in the second of two reports minus its value in the first."""
        return self.after[0] - self.before[0]

    @property
    def in_deviations(self) -> float:
        """Change of the parameter in units of its standard error; 0 without a standard error."""
        return self.difference / self.stderr if self.stderr else 0.0

    @property
    def z(self) -> float:
        """Magnitude of the parameter's change in units of its standard error."""
        return abs(self.in_deviations)

    @property
    def significant(self) -> bool:
        """True if the change of the parameter is significant."""
        return self.chance < SIGNIFICANCE


@dataclass(frozen=True)
class Comparison:
    """Comparison of two calibration reports of one machine.

    parameters, effects, placement: changes of the quantities in both reports, largest change in standard errors first.
    only_before, only_after: names of the effects that one report alone contains.
    incomparable: parameters that were fitted in one report only; other parameters absorb the error in the other report.
    shared: number of rows to which both models were fitted.
    sources: names of the two reports.
    """

    before: Report
    after: Report
    parameters: tuple[Change, ...]
    effects: tuple[Change, ...]
    placement: tuple[Change, ...]
    only_before: tuple[EffectRecord, ...]
    only_after: tuple[EffectRecord, ...]
    incomparable: tuple[str, ...]
    shared: int
    sources: tuple[str, str]

    @property
    def of_models(self) -> bool:
        """True if both reports use equal rows of measurements, so that only the models differ."""
        return self.shared == self.before.data.poses == self.after.data.poses


def compare(before: Report, after: Report, sources: tuple[str, str] | None = None) -> Comparison:
    """Compare two reports of one machine, with the joint names of the second report.
    sources: names of the two reports, by default the names of their tables. Raises InputError if the machines differ.
    """
    if not _one_machine(before.mechanism, after.mechanism):
        raise InputError(
            f"compare: {before.mechanism.name} ({len(before.mechanism.joints)} joints) and {after.mechanism.name} "
            f"({len(after.mechanism.joints)}) have different nominal tips at equal joint values; expected two "
            "calibrations of one machine"
        )
    before, shared = _named_as(before, after.mechanism.joints), shared_rows(before, after)
    old, new = ({e.name: e for e in r.effects} for r in (before, after))
    first, second = ({p.name: p for p in r.geometry() if p.stderr} for r in (before, after))
    placed = ({p.name: p for p in r.placement} for r in (before, after))
    both = (shared / max(before.data.poses, 1), shared / max(after.data.poses, 1))
    freedoms = np.array([[np.inf if r.freedom is None else r.freedom] for r in (before, after)])
    changes = partial(_changes, shared=both, freedoms=freedoms)
    parameters, effects, placement = _corrected(
        [changes(first, second), changes(old, new), changes(*_turned_alike(*placed))]
    )
    return Comparison(
        before=before,
        after=after,
        parameters=parameters,
        effects=effects,
        placement=placement,
        only_before=tuple(e for n, e in old.items() if n not in new),
        only_after=tuple(e for n, e in new.items() if n not in old),
        incomparable=tuple(sorted(set(first) ^ set(second))),
        shared=shared,
        sources=sources or (before.data.file, after.data.file),
    )


def _one_machine(one: MechanismRecord, other: MechanismRecord) -> bool:
    """Return True if two records describe one machine: equal tip positions, or equal names if a tip position is
    unknown."""
    if len(one.joints) != len(other.joints):
        return False
    if one.tip_at_probe_m is None or other.tip_at_probe_m is None:
        return one.name == other.name
    return same_machine(one.tip_at_probe_m, other.tip_at_probe_m)


def _named_as(report: Report, joints: tuple[str, ...]) -> Report:
    """Return a copy of a report with the joints in the names of its parameters and effects renamed."""
    names = table_names(report.mechanism.joints, joints)
    return replace(
        report,
        parameters=tuple(replace(p, name=translate(p.name, names)) for p in report.parameters),
        effects=tuple(replace(e, name=translate(e.name, names)) for e in report.effects),
    )


def shared_rows(before: Report, after: Report) -> int:
    """Return the number of rows to which both models were fitted, from the digests of the rows.
    Without digests, all rows of identical table files count as shared, and no row of different files."""
    if before.data.marks and after.data.marks:
        return (Counter(before.data.marks) & Counter(after.data.marks)).total()
    alike = before.data.sha256 == after.data.sha256 != ""
    return before.data.poses if alike and before.data.poses == after.data.poses else 0


def _turned_alike(
    old: Mapping[str, ParameterRecord], new: Mapping[str, ParameterRecord]
) -> tuple[Mapping[str, ParameterRecord], Mapping[str, ParameterRecord]]:
    """Return registration and tool of both reports, with rotation vectors of the second report in the nearest turn.
    Near half a turn a rotation vector and its opposite describe one orientation."""
    out = dict(new)
    for name in {n.removesuffix(" rx") for n in old if n.endswith(" rx")}:
        axes = [f"{name} r{axis}" for axis in "xyz"]
        if not all(a in old and a in new for a in axes):
            continue
        first, second = (np.array([of[a].value or 0.0 for a in axes]) for of in (old, new))
        turn = float(np.linalg.norm(second))
        other = second * (1.0 - 2.0 * np.pi / turn) if turn > 0 else second
        if np.linalg.norm(other - first) < np.linalg.norm(second - first):
            out |= {a: replace(new[a], value=float(v)) for a, v in zip(axes, other, strict=True)}
    return old, out


def _changes(
    old: Mapping[str, Record], new: Mapping[str, Record], shared: tuple[float, float], freedoms: Array
) -> tuple[Change, ...]:
    """Return the change of every quantity in both reports, with the p-value of a two-sided Student's t test.

    shared: share of the rows of each report that the other report also has; shared rows correlate the estimates. For s
    shared rows of the n rows of a report, the covariance is the smaller of the two values (s / n) v, with v the
    variance of the estimate in the other report. The covariance is exact if one table contains the other (Hausman 1978:
    the variance of the difference is the difference of the variances).
    freedoms: degrees of freedom of the standard errors of each report.
    """
    pairs = [
        Change(name, a.unit, (a.value, a.stderr), (b.value, b.stderr), _of_difference(a.stderr, b.stderr, shared))
        for name, a in old.items()
        if (b := new.get(name)) is not None
        and a.unit == b.unit
        and a.value is not None and b.value is not None and a.stderr and b.stderr
    ]  # fmt: skip
    ordered = sorted(pairs, key=lambda c: (-c.z, -abs(c.difference) / c.after[1]))
    deviations = np.array([(c.before[1], c.after[1]) for c in ordered]).reshape(-1, 2).T
    chances = 2 * special.stdtr(freedom_of_sum(deviations, freedoms), [-c.z for c in ordered])
    return tuple(replace(c, chance=float(p)) for c, p in zip(ordered, chances, strict=True))


def _corrected(lists: Sequence[tuple[Change, ...]]) -> list[tuple[Change, ...]]:
    """Correct the p-values of parameter changes for the number of all comparisons (Holm)."""
    chances = iter(holm(np.array([c.chance for c in chain(*lists)])))
    return [tuple(replace(c, chance=float(next(chances))) for c in changes) for changes in lists]


def _of_difference(before: float, after: float, shared: tuple[float, float]) -> float | None:
    """Return the standard error of the difference of two estimates, None if both use equal rows of a table."""
    if min(shared) >= 1.0:
        return None
    common = min(shared[0] * after**2, shared[1] * before**2)
    return float(np.sqrt(max(before**2 + after**2 - 2.0 * common, abs(before**2 - after**2))))


SIDES = ("before", "after")


def verdict(found: Comparison) -> str:
    """State the significant changes between two calibrations in one sentence.
    If different parameters were fitted, other parameters absorb the missing parameters; changes of absorbing parameters
    are not counted."""
    tool = [c for c in found.placement if c.name.startswith("tool")]
    compared = (*found.effects, *(() if found.incomparable else (*found.parameters, *tool)))
    changed = [c.name for c in compared if c.significant]
    many = f"{len(compared)} quantit{'y' if len(compared) == 1 else 'ies'}"
    parts = [f"{len(changed)} of {many} changed beyond chance" if changed else f"No change beyond chance in {many}"]
    if found.of_models:
        parts = [
            "Both models were fitted to the same rows: the differences are those of the models, not of the machine"
        ]
        apart = any(c.difference for c in (*compared, *found.placement))
        if not (apart or found.incomparable or found.only_before or found.only_after):
            parts = ["Both models were fitted to the same rows and are equal"]
    elif found.shared:
        parts[0] += f"; {found.shared} rows are in both tables (the σ of the changes allow for the common rows)"
    parts += ["the registration moved"] if any(c.significant for c in found.placement if c not in tool) else []
    parts += [f"largest: {', '.join(changed[:4])}"] if changed else []
    parts += [f"new: {' and '.join(e.name for e in found.only_after)}"] if found.only_after else []
    parts += [f"gone: {' and '.join(e.name for e in found.only_before)}"] if found.only_before else []
    parts += (
        ["the two models have different parameters, so that no parameters are compared"] if found.incomparable else []
    )
    return "; ".join(parts) + "."


def tables(found: Comparison) -> tuple[tuple[str, tuple[Change, ...]], ...]:
    """Return the changes of parameters, of effects, and of registration and tool, with headings."""
    placed = "Tool in the flange, root in the instrument's frame"
    return ("Effects", found.effects), ("Parameters", found.parameters), (placed, found.placement)


def text(found: Comparison) -> str:
    """Return the comparison of two calibrations as text in 80 columns, with a star at significant changes."""
    sources = zip(SIDES, found.sources, strict=True)
    heads = f"    {'':16}{'before':>11} {'after':>11} {'change':>18} {'':10}{'in σ':>5}"
    said = (
        "fitted in one model only (in the other model, other parameters absorb these errors): "
        f"{', '.join(found.incomparable)}"
    )
    blocks = (
        ("Verdict", [wording.wrapped(verdict(found))]),
        ("Compared", [wording.wrapped(source, 11, f"    {side:6} ") for side, source in sources]),
        *((title, [heads, *map(_row, changes)] if changes else []) for title, changes in tables(found)),
        ("Not comparable", [wording.wrapped(said)] if found.incomparable else []),
    )
    return wording.titled(blocks)


def cells(c: Change) -> tuple[str, str, str, str]:
    """Return the values before and after and the change ± σ of a parameter as text in one unit, and the unit."""
    least = min(c.before[1], c.after[1]) if c.stderr is None else c.stderr
    largest = max(abs(c.before[0]), abs(c.after[0]), least)
    factor, unit = wording.OF_LISTS.get(c.unit) or wording.prefix(largest, c.unit)
    places = min(6, max(0, 1 - int(np.floor(np.log10(factor * least)))))
    old, new, change = (
        wording.minus(f"{factor * v:{sign}.{places}f}")
        for v, sign in ((c.before[0], ""), (c.after[0], ""), (c.difference, "+"))
    )
    return old, new, change if c.stderr is None else f"{change} ± {factor * c.stderr:.{places}f}", unit


def _row(c: Change) -> str:
    old, new, change, unit = cells(c)
    name, mark = wording.short_name(c.name, 16), "*" if c.significant else ""
    sure = "" if c.stderr is None else f"{c.z:.1f}"
    return f"    {name:<16}{old:>11} {new:>11} {change:>18} {unit:<10}{sure:>5}{mark}".rstrip()


MOST = 40
"""Largest number of parameter changes in a picture; the largest changes are shown."""


def picture(changes: Sequence[Change]) -> Picture | None:
    """Return a picture of the parameter changes in units of their σ, so that lengths and angles are comparable; None
    without σ."""
    known = sorted((c for c in changes if c.stderr), key=lambda c: -c.z)[:MOST]
    if not known:
        return None
    largest = ", ".join(f"{c.name} {wording.minus(f'{c.in_deviations:+.1f}')} σ" for c in known[:4])
    return Picture(
        "changes", "Changes in units of σ", 5.6, 0.6 + 0.19 * len(known), f"Changes in units of σ: {largest}.",
        ("Change ± σ, in units of σ. Filled: significant, corrected for the number of "
        "comparisons."), partial(_draw, changes=known),
    )  # fmt: skip


def _draw(figure: Figure, changes: Sequence[Change]) -> None:
    rows = [(wording.short_name(c.name, 34), c.in_deviations, 1.0, c.significant) for c in changes]
    forest(figure.subplots(), rows, "change ± σ, in σ")


def html(found: Comparison) -> str:
    """Return the comparison of two calibrations as an HTML page."""
    from gpmodel.report.page import render

    chart = picture([c for _, changes in tables(found) for c in changes])
    return render(
        "compare.html.j2",
        found=found, verdict=verdict(found), cells=cells, tables=tables(found), sides=SIDES, picture=chart,
    )  # fmt: skip
