"""A comparison of two calibrations in words: its verdict, and its tables in 80 columns."""

import numpy as np

from gpmodel import wording
from gpmodel.report.compare import Change, Comparison

SIDES = ("before", "after")


def verdict(found: Comparison) -> str:
    """One sentence on what changed beyond chance.

    Where not the same parameters were fitted, the others took the missing ones up: their changes are then not counted.
    """
    tool = [c for c in found.placement if c.name.startswith("tool")]
    compared = (*found.effects, *(() if found.incomparable else (*found.parameters, *tool)))
    changed = [c.name for c in compared if c.significant]
    many = f"{len(compared)} quantit{'y' if len(compared) == 1 else 'ies'}"
    parts = [f"{len(changed)} of {many} changed beyond chance" if changed else f"No change beyond chance in {many}"]
    if found.of_models:
        parts = ["The same rows, another model: what differs is of the models, not of the machine"]
        apart = any(c.difference for c in (*compared, *found.placement))
        if not (apart or found.incomparable or found.only_before or found.only_after):
            parts = ["The same rows and the same numbers"]
    elif found.shared:
        parts[0] += f"; {found.shared} rows are in both tables, which the σ of the changes allow for"
    parts += ["the registration moved"] if any(c.significant for c in found.placement if c not in tool) else []
    parts += [f"largest: {', '.join(changed[:4])}"] if changed else []
    parts += [f"new: {' and '.join(e.name for e in found.only_after)}"] if found.only_after else []
    parts += [f"gone: {' and '.join(e.name for e in found.only_before)}"] if found.only_before else []
    parts += ["not the same parameters were fitted, so that none of them is compared"] if found.incomparable else []
    return "; ".join(parts) + "."


def tables(found: Comparison) -> tuple[tuple[str, tuple[Change, ...]], ...]:
    """Return the compared quantities by heading."""
    placed = "Tool in the flange, root in the instrument's frame"
    return ("Effects", found.effects), ("Parameters", found.parameters), (placed, found.placement)


def text(found: Comparison) -> str:
    """The comparison in 80 columns, changes beyond chance marked with a star."""
    sources = zip(SIDES, found.sources, strict=True)
    heads = f"    {'':16}{'before':>11} {'after':>11} {'change':>18} {'':10}{'in σ':>5}"
    said = f"fitted in one only, so the others took them up there: {', '.join(found.incomparable)}"
    blocks = (
        ("Verdict", [wording.wrapped(verdict(found))]),
        ("Compared", [wording.wrapped(source, 11, f"    {side:6} ") for side, source in sources]),
        *((title, [heads, *map(_row, changes)] if changes else []) for title, changes in tables(found)),
        ("Not comparable", [wording.wrapped(said)] if found.incomparable else []),
    )
    return wording.titled(blocks)


def cells(c: Change) -> tuple[str, str, str, str]:
    """Before, after and change ± σ in one unit, which is that of all lengths or all angles, and the unit."""
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
