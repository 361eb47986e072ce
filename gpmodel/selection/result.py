"""What a selection chose: groups with gains, values, and what could stand in their place."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array
from gpmodel.model.effect import Effect
from gpmodel.selection.active import Active
from gpmodel.selection.exchange import Alternative
from gpmodel.selection.group import Group
from gpmodel.selection.moves import found
from gpmodel.selection.refit import Expansion


@dataclass(frozen=True)
class Kept:
    """A group in the model. gain: nats over the model without it, its cost not counted. rivals: groups that could stand
    in its place, with the nats lost. determined: how many of its unknowns the data say more of than the prior does."""

    group: Group
    gain: float
    variance: float
    rivals: tuple[tuple[Group, float], ...] = ()
    determined: float = 0.0

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects with their learned priors."""
        return self.group.with_prior(self.variance)


@dataclass(frozen=True)
class Selection:
    """The groups that were chosen, by gain. state: of the exact fit behind them. by_chance: (T,) the most nats, costs
    counted, that any group gains on T permuted residuals of it. evidence: log marginal likelihood, costs counted."""

    kept: tuple[Kept, ...]
    state: Expansion
    by_chance: Array
    evidence: float

    def likelier_by(self, other: "Selection") -> float:
        """Nats of its evidence over another one's; 0 where they left other poses out and are not to be compared."""
        alike = bool((self.state.fitting.use == other.state.fitting.use).all())
        return self.evidence - other.evidence if alike else 0.0


def summarised(
    active: Active, rivals: Mapping[int, tuple[Alternative, ...]], state: Expansion, by_chance: Array
) -> Selection:
    """What was chosen, from the groups in the model, their rivals and the exact fit."""
    kept: list[Kept] = []
    for g in found(active):
        group, variance, pick = active.pool.groups[g], active.variances[g], active.chosen[g].tolist()
        effects, spreads = tuple(group.effects[k] for k in pick), tuple(group.spreads[k] for k in pick)
        group = replace(group, effects=effects, spreads=spreads)
        others = tuple((active.pool.groups[r.number], r.loss) for r in rivals.get(g, ()))
        said = variance * active.own(g)[0]
        determined = float(np.sum(said / (1.0 + said)))
        kept.append(Kept(group, active.gains[g][0], variance, others, determined))
    return Selection(tuple(sorted(kept, key=lambda k: -k.gain)), state, by_chance, active.evidence)
