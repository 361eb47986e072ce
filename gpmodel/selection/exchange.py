"""One group for another, and one for several: what adding and pruning alone do not find."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.selection.active import Active
from gpmodel.selection.merge import LAW, TRIED, curves_to_laws, merged, replace_catch_alls
from gpmodel.selection.moves import SETTLED, backward_eliminated, found, split, stepwise, with_optimal_variances
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
    active, groups = replacements.active, replacements.active.pool.groups
    own, kept = active.net_nats(g), groups[g]
    near = np.array([bool(h.family) and (h.family, h.inputs) == (kept.family, kept.inputs) for h in groups])
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
        active = merged(split(replace_catch_alls(curves_to_laws(merged(active)))))
        rivals, changed, replacements = {}, False, Replacements(_freed(active))
        for g in found(active):
            if g not in active.variances:
                continue
            rivals[g], variances = instead_of(replacements, g)
            better = _swapped(active, g, rivals[g], variances)
            if better is not active:
                active, changed, replacements = better, True, Replacements(_freed(better))
        if not changed:
            break
        active = stepwise(active)
    return active, {g: rivals.get(g, ()) for g in found(active)}


def _freed(active: Active) -> Active:
    """The model with the laws that were found free to be of another size: a rival of one may ask it of the rest."""
    laws = {g for g in found(active) if len(active.pool.groups[g].effects) <= LAW}
    return replace(active, variances={g: a * FREE if g in laws else a for g, a in active.variances.items()})


def _swapped(active: Active, g: int, rivals: Sequence[Alternative], variances: Array) -> Active:
    """The model with the first of the nearest rivals in the place of a kept group that raises the evidence enough: by
    what settles it where it is cheaper to name and of no more unknowns, since of two that explain the same the better
    known and simpler one is likelier; else by what a swap has to bring. Not with what it is itself a part of, which
    would be split again."""
    cost, groups = active.pool.cost, active.pool.groups

    def able(r: Alternative) -> bool:
        whole = groups[g].name in {part.name for part in groups[r.number].parts}
        return r.loss < active.criteria.rival_nats and not whole

    for h in [r.number for r in sorted(filter(able, rivals), key=lambda r: r.loss)[:TRIED]]:
        trial = backward_eliminated(with_optimal_variances(active.without(g).added(h, float(variances[h])), 4))
        known = cost[h] < cost[g] and len(groups[h].effects) <= len(groups[g].effects)
        if trial.evidence > active.evidence + (SETTLED if known else active.criteria.swap_nats):
            return trial
    return active
