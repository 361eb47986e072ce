"""What changed between two calibrations of a machine, parameter by parameter and effect by effect."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from textwrap import fill

import numpy as np
from scipy import stats

from gpmodel import wording
from gpmodel.errors import InputError
from gpmodel.numerics.multiple import SIGNIFICANCE, holm
from gpmodel.report.page import render
from gpmodel.report.schema import ParameterRecord, Report
from gpmodel.report.schema_search import EffectRecord


@dataclass(frozen=True)
class Change:
    """value ± stderr before and after, SI; chance: of so large a difference without a change, corrected (Holm)."""

    name: str
    unit: str
    before: tuple[float, float]
    after: tuple[float, float]
    chance: float

    @property
    def difference(self) -> float:
        """After less before."""
        return self.after[0] - self.before[0]

    @property
    def stderr(self) -> float:
        """σ of the difference of two independent estimates."""
        return float(np.hypot(self.before[1], self.after[1]))

    @property
    def z(self) -> float:
        """The difference in its own σ."""
        return abs(self.difference) / self.stderr

    @property
    def significant(self) -> bool:
        """Whether the change is beyond chance."""
        return self.chance < SIGNIFICANCE


@dataclass(frozen=True)
class Comparison:
    """parameters, effects, placement: what both know, largest change in σ first. only_before, only_after: effects.

    incomparable: parameters that one fitted and the other could not; the others absorbed them there.
    """

    before: Report
    after: Report
    parameters: tuple[Change, ...]
    effects: tuple[Change, ...]
    placement: tuple[Change, ...]
    only_before: tuple[EffectRecord, ...]
    only_after: tuple[EffectRecord, ...]
    incomparable: tuple[str, ...]


def compare(before: Report, after: Report) -> Comparison:
    """Two reports of one mechanism. Raises InputError where the mechanisms differ."""
    if (before.mechanism.name, len(before.mechanism.joints)) != (after.mechanism.name, len(after.mechanism.joints)):
        raise InputError(
            f"compare: {before.mechanism.name} with {len(before.mechanism.joints)} joints and {after.mechanism.name} "
            f"with {len(after.mechanism.joints)}; expected two calibrations of one machine"
        )
    old, new = ({e.name: e for e in r.effects} for r in (before, after))
    first, second = ({p.name: p for p in r.geometry() if p.stderr} for r in (before, after))
    return Comparison(
        before=before,
        after=after,
        parameters=_changes(first, second),
        effects=_changes(old, new),
        placement=_changes({p.name: p for p in before.placement}, {p.name: p for p in after.placement}),
        only_before=tuple(e for n, e in old.items() if n not in new),
        only_after=tuple(e for n, e in new.items() if n not in old),
        incomparable=tuple(sorted(set(first) ^ set(second))),
    )


def _changes(
    old: Mapping[str, ParameterRecord | EffectRecord], new: Mapping[str, ParameterRecord | EffectRecord]
) -> tuple[Change, ...]:
    """Every quantity of both, with its chance by a two-sided normal test corrected for their number."""
    pairs = [
        Change(name, a.unit, (a.value, a.stderr), (b.value, b.stderr), 1.0)
        for name, a in old.items()
        if (b := new.get(name)) is not None
        and a.unit == b.unit
        and a.value is not None and b.value is not None and a.stderr and b.stderr
    ]  # fmt: skip
    ordered = sorted(pairs, key=lambda c: -c.z)
    chances = holm(2 * stats.norm.sf([c.z for c in ordered]))
    return tuple(replace(c, chance=float(p)) for c, p in zip(ordered, chances, strict=True))


def verdict(found: Comparison) -> str:
    """One sentence on what changed beyond chance.

    Where not the same parameters were fitted, the others took the missing ones up: their changes are then not counted.
    """
    compared = (*found.effects, *(() if found.incomparable else found.parameters))
    changed = [c.name for c in compared if c.significant]
    parts = [f"{len(changed)} of {len(compared)} quantities changed beyond chance"]
    parts += [f"largest: {', '.join(changed[:4])}"] if changed else []
    parts += [f"new: {' and '.join(e.name for e in found.only_after)}"] if found.only_after else []
    parts += [f"gone: {' and '.join(e.name for e in found.only_before)}"] if found.only_before else []
    parts += ["not the same parameters were fitted, so that none of them is compared"] if found.incomparable else []
    return "; ".join(parts) + "."


def tables(found: Comparison) -> tuple[tuple[str, tuple[Change, ...]], ...]:
    """What is compared, by heading."""
    return (
        ("Effects", found.effects),
        ("Parameters", found.parameters),
        ("Tool in the flange, root in the instrument's frame", found.placement),
    )


def text(found: Comparison) -> str:
    """The comparison in 80 columns, changes beyond chance marked with a star."""
    lines = ["[[Verdict]]", fill(verdict(found), wording.WIDTH, initial_indent="    ", subsequent_indent="    ")]
    for title, changes in tables(found):
        if changes:
            lines += [f"[[{title}]]", f"    {'':19}{'before':>10}{'after':>10}{'change':>20} {'':10}{'in σ':>5}"]
            lines += [_row(c) for c in changes]
    if found.incomparable:
        said = f"fitted in one only, so the others took them up there: {', '.join(found.incomparable)}"
        lines += ["[[Not comparable]]", fill(said, wording.WIDTH, initial_indent="    ", subsequent_indent="    ")]
    return "\n".join(lines)


def cells(c: Change) -> tuple[str, str, str, str]:
    """Before, after and change ± σ in one prefix, and the unit."""
    factor, unit = wording.prefix(max(abs(c.before[0]), abs(c.after[0]), c.stderr), c.unit)
    places = min(6, max(0, 1 - int(np.floor(np.log10(factor * c.stderr)))))
    old, new, change = (
        wording.minus(f"{factor * v:{sign}.{places}f}")
        for v, sign in ((c.before[0], ""), (c.after[0], ""), (c.difference, "+"))
    )
    return old, new, f"{change} ± {factor * c.stderr:.{places}f}", unit


def _row(c: Change) -> str:
    old, new, change, unit = cells(c)
    name, mark = wording.short_name(c.name, 19), "*" if c.significant else ""
    return f"    {name:<19}{old:>10}{new:>10}{change:>20} {unit:<10}{c.z:>5.1f}{mark}".rstrip()


def html(found: Comparison) -> str:
    """The comparison as a page."""
    return render("compare.html.j2", found=found, verdict=verdict(found), cells=cells, tables=tables(found))
