"""Where candidates act, and those that act at one place as one."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import replace

from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import family
from gpmodel.selection.group import Group

TOGETHER, NUMBERS = 2, 3
"""Inputs of a law, and the numbers that one of a few nodes has."""


def of_one_place(candidates: Iterable[Candidate]) -> Iterator[tuple[tuple[str, ...], Candidate]]:
    """Candidates at one place that read two inputs together, their names and all as one: functions of both and of one
    of them may stand for one law. Those that all have names stay what they are if they read two or have more numbers
    than a law."""
    at: dict[frozenset[object], list[Candidate]] = defaultdict(list)
    for one in candidates:
        at[places(one)].append(one)
    for sites, parts in at.items():
        read = {name for c in parts for name in c.inputs}
        effects = tuple(e for c in parts for e in c.effects)
        named = all(c.family and not is_curve(c) for c in parts)
        most = (1 if len(effects) <= NUMBERS else 0) if named else TOGETHER
        if len(sites) == 1 and len(parts) > 1 and len(read) <= most:
            names, cost = tuple(c.name for c in parts), sum(c.cost for c in parts)
            said = " and ".join(names)
            whole = replace(parts[0], name=said, effects=effects, family="", found_by="evolved", cost=cost, inner=None)
            yield names, whole


def places(candidate: Candidate) -> frozenset[tuple[tuple[str, str, float], ...]]:
    """Slots, axes and weights at which it acts."""
    return frozenset(tuple((t.slot, t.axis, t.weight) for t in effect.terms) for effect in candidate.effects)


def is_curve(group: Group | Candidate) -> bool:
    """Whether it says how something looks and names no part."""
    known = family(group.family)
    return group.found_by == "surface" or (known is not None and known.generic)
