"""Alternatives: groups that explain nearly as much in the place of a selected one, everything else as it is."""

from dataclasses import dataclass

import numpy as np

from gpmodel.selection.active import Active
from gpmodel.selection.scan import Replacements

MOST_RIVALS = 20
"""Alternatives kept of a group, nearest first."""


@dataclass(frozen=True)
class Alternative:
    """A group that could take the place of a selected one. loss: of the objective, nats."""

    number: int
    loss: float


def alternatives(active: Active) -> dict[int, tuple[Alternative, ...]]:
    """The best groups in the place of each selected one, neighbours first, then nearest first.

    Neighbours are of its family and inputs and are listed whatever the loss: another number of lobes may predict as
    well and differ in the value and in the geometry.
    """
    replacements = Replacements(active)
    return {g: _in_place_of(replacements, g) for g in active.found}


def _in_place_of(replacements: Replacements, g: int) -> tuple[Alternative, ...]:
    active, kind = replacements.active, replacements.active.pool.kind
    own, near = active.net_gain(g), (kind == kind[g]) & (kind >= 0)
    margin = np.where(near, np.inf, active.criteria.rival_nats)
    prices = active.without(g).prices
    gains, _ = replacements.of(g, own + prices - margin)
    losses = own - (gains - prices)
    losses[list(active.variances)] = np.inf
    able = [h for h in np.lexsort((losses, ~near)).tolist() if np.isfinite(losses[h]) and losses[h] < margin[h]]
    return tuple(Alternative(h, float(losses[h])) for h in able[:MOST_RIVALS])
