"""One group for another, and one for several: what adding and pruning alone do not find."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.selection.active import Active
from gpmodel.selection.merge import LAW, TRIED, curves_to_laws, merged, replace_catch_alls
from gpmodel.selection.moves import (
    SETTLED,
    backward_eliminated,
    first_better,
    found,
    split,
    stepwise,
    with_optimal_variances,
)
from gpmodel.selection.scan import Replacements

MOST_SWAPS = 4
"""Rounds of swaps at most; they end by themselves far earlier."""
MOST_RIVALS = 20
"""Rivals kept of a group, nearest first."""

FREE = 1e4
"""How many times their variance laws have while another is exchanged: a hundred times their size holds them no more."""


@dataclass(frozen=True)
class Alternative:
    """A group that could stand in the place of a kept one at a loss of so many nats, its cost counted."""

    number: int
    loss: float


def instead_of(replacements: Replacements, g: int) -> tuple[tuple[Alternative, ...], Array]:
    """The best groups in place of a kept one, its own neighbours first, then nearest first, and the variance (G,) each
    would have.

    Neighbours are of its family and read the same, at whatever loss: another number of lobes may predict as well as
    this one and differ in how large it and the geometry beside it would be, which is no evidence against it.
    """
    active, kind = replacements.active, replacements.active.pool.kind
    own, near = active.net_nats(g), (kind == kind[g]) & (kind >= 0)
    margin = np.where(near, np.inf, active.criteria.rival_nats)
    gains, variances = replacements.of(g, own - margin)
    losses = own - (gains - active.pool.cost)
    losses[list(active.variances)] = np.inf
    order = np.lexsort((losses, ~near))
    able = [h for h in order.tolist() if np.isfinite(losses[h]) and losses[h] < margin[h]]
    return tuple(Alternative(h, float(losses[h])) for h in able[:MOST_RIVALS]), variances


def exchanged(active: Active) -> tuple[Active, dict[int, tuple[Alternative, ...]]]:
    """Exchange kept groups and select forward again until neither helps; the rivals of each group.

    Groups of several places are said by name where they can be, and several groups at one place by one.
    """
    rivals: dict[int, tuple[Alternative, ...]] = {}
    for _ in range(MOST_SWAPS):
        moved = split(replace_catch_alls(curves_to_laws(merged(active))))
        active = active if moved is active else merged(moved)
        rivals, changed, held, free = {}, False, Replacements(active), Replacements(_freed(active))
        for g in found(active):
            if g not in active.variances:
                continue
            rivals[g], variances = instead_of(held, g)
            better = first_better(active, _instead(active, g, _successor(active, g, rivals[g]), variances))
            if better is active and _is_law(active, g):
                rivals[g], variances = instead_of(free, g)
                better = _swapped(active, g, rivals[g], variances)
            if better is not active:
                active, changed, held, free = better, True, Replacements(better), Replacements(_freed(better))
        if not changed:
            break
        active = stepwise(active)
    return active, {g: rivals.get(g, ()) for g in found(active)}


def _is_law(active: Active, g: int) -> bool:
    """Whether a group is a law by itself, at one place or at several that are one."""
    group = active.pool.groups[g]
    return len(group.effects) <= LAW and not group.parts


def _freed(active: Active) -> Active:
    """The model with the laws that were found free to be of another size: a rival of one may ask it of the rest."""
    laws = {g for g in found(active) if _is_law(active, g)}
    return replace(active, variances={g: a * FREE if g in laws else a for g, a in active.variances.items()})


def _instead(active: Active, g: int, others: Sequence[int], variances: Array) -> Iterator[Active]:
    """The model with each of several groups in the place of a kept one, its variances optimal."""
    for h in others:
        yield backward_eliminated(with_optimal_variances(active.without(g).added(h, float(variances[h])), 4))


def _successor(active: Active, g: int, rivals: Sequence[Alternative]) -> list[int]:
    """The nearest rival that takes the place of a kept group with all others as large as they are, if any: better by
    what a swap has to bring, or no worse and known better."""
    needed = active.criteria.swap_nats
    able = (r for r in rivals if r.loss < (0.0 if _known_better(active, r.number, g) else -needed))
    return [r.number for r in sorted(able, key=lambda r: r.loss)[:1]]


def _swapped(active: Active, g: int, rivals: Sequence[Alternative], variances: Array) -> Active:
    """The model with the first of the nearest laws in the place of a kept one that raises the evidence, the others as
    large as that asks of them: by what a swap has to bring, or by what settles it where it is known better."""
    near = [r for r in rivals if r.loss < active.criteria.rival_nats and _is_law(active, r.number)]
    others = [r.number for r in sorted(near, key=lambda r: r.loss)[:TRIED]]
    for h, trial in zip(others, _instead(active, g, others, variances), strict=True):
        needed = SETTLED if _known_better(active, h, g) else active.criteria.swap_nats
        if trial.evidence > active.evidence + needed:
            return trial
    return active


def _known_better(active: Active, h: int, g: int) -> bool:
    """Whether a group is cheaper to name than another and of no more unknowns: of two that explain the same it is
    likelier."""
    cost, groups = active.pool.cost, active.pool.groups
    return bool(cost[h] < cost[g]) and len(groups[h].effects) <= len(groups[g].effects)
