"""What a selection chose: groups with gains, values, and what could stand in their place."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evidence.units import exchangeable
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.selection.by_chance import best_by_chance
from gpmodel.selection.group import Group
from gpmodel.selection.look import Look, Screening
from gpmodel.selection.offers import shared_kinds
from gpmodel.selection.refit import Expansion
from gpmodel.table.split import JUDGED


@dataclass(frozen=True)
class Kept:
    """A group in the model. gain: nats over the model without it, its cost not counted. rivals: groups that could stand
    in its place, with the nats lost. determined: how many of its unknowns the data say more of than the prior does.
    shared: nats of its cost that another selected group of its kind pays."""

    group: Group
    gain: float
    variance: float
    rivals: tuple[tuple[Group, float], ...] = ()
    determined: float = 0.0
    shared: float = 0.0

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects with their learned priors."""
        return self.group.with_prior(self.variance)


@dataclass(frozen=True)
class Offered:
    """The groups that a selection may choose from.

    always: always included. single: of the catalogue and evolved. proposed: smooth terms, sinusoids and formulas that a
    residual asked for. grids: of sinusoids.
    """

    screening: Screening
    always: tuple[Group, ...]
    single: tuple[Group, ...]
    proposed: tuple[Group, ...]
    grids: Sequence[FrequencyGrid]

    def with_formulas_of(self, curves: frozenset[str]) -> "Offered":
        """The same where formulas of some curves are offered, too: these pay for reading from then on."""
        prices = self.screening.prices
        prices = replace(prices, with_formulas=prices.with_formulas | curves)
        return replace(self, screening=replace(self.screening, prices=prices))

    def groups(self, mechanism: Mechanism) -> list[Group]:
        """All of them, those of one kind at several joints as one more each."""
        return [*self.always, *self.single, *shared_kinds(mechanism, self.single), *self.proposed]


@dataclass(frozen=True)
class Selection:
    """The groups that were chosen, by gain, among which, and the last look at them."""

    kept: tuple[Kept, ...]
    offered: Offered
    look: Look

    @property
    def state(self) -> Expansion:
        """The exact fit behind it."""
        return self.look.state

    @property
    def names(self) -> frozenset[str]:
        """Names of the selected groups."""
        return frozenset(kept.group.name for kept in self.kept)

    @cached_property
    def by_chance(self) -> Array:
        """The most nats (T,), costs counted, that any group gains on T permuted residuals of it."""
        screening, rng = self.offered.screening, np.random.default_rng(JUDGED)
        together = exchangeable(self.state.fitting.poses.dataset, screening.prices.limits)
        return best_by_chance(self.look.active, self.offered.grids, together, rng, screening.prices.limits.shuffles)


def summarised(offered: Offered, look: Look) -> Selection:
    """What was chosen, from the groups in the model and their rivals."""
    active = look.active
    kept: list[Kept] = []
    for g in active.found:
        group, variance, pick = active.pool.groups[g], active.variances[g], active.chosen[g].tolist()
        effects, spreads = tuple(group.effects[k] for k in pick), tuple(group.spreads[k] for k in pick)
        group = replace(group, effects=effects, spreads=spreads)
        others = tuple((active.pool.groups[r.number], r.loss) for r in look.rivals.get(g, ()))
        said = variance * active.own(g)[0]
        determined = float(np.sum(said / (1.0 + said)))
        shared = float(active.pool.price[g] - active.prices[g])
        kept.append(Kept(group, active.gains[g][0], variance, others, determined, shared))
    return Selection(tuple(sorted(kept, key=lambda k: -k.gain)), offered, look)
