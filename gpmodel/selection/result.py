"""What a selection chose: groups with gains, values, and what could stand in their place."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.model.effect import Effect
from gpmodel.selection.active import Active
from gpmodel.selection.exchange import Alternative
from gpmodel.selection.group import Group
from gpmodel.selection.refit import Refit


@dataclass(frozen=True)
class Kept:
    """A group in the model. gain: nats over the model without it, its cost not counted. values, stderr: (E,) of its
    effects. rivals: groups that could stand in its place, with the nats lost. determined: how many of its unknowns the
    data say more of than the prior does."""

    group: Group
    gain: float
    variance: float
    values: Array
    stderr: Array
    rivals: tuple[tuple[Group, float], ...] = ()
    determined: float = 0.0

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects with their learned priors."""
        return self.group.with_prior(self.variance)


@dataclass(frozen=True)
class Selection:
    """What was chosen: geometry with learned variances, then the kept groups by gain. noise: σ of one measured
    component, m. fit: the exact fit behind the numbers. by_chance: (T,)
    the most nats, costs counted, that any group gains on T permuted residuals of it."""

    geometry: tuple[Kept, ...]
    kept: tuple[Kept, ...]
    offered: int
    evidence: float
    noise: float
    fit: Refit
    by_chance: Array

    @property
    def error(self) -> Array:
        """3-D error (N,) of each pose, m."""
        return self.fit.error

    @property
    def outliers(self) -> IntArray:
        """Poses that the fit left out."""
        return np.flatnonzero(~self.fit.point.use)


def summarised(
    active: Active, rivals: Mapping[int, tuple[Alternative, ...]], fit: Refit, offered_groups: int, by_chance: Array
) -> Selection:
    """What was chosen in words and numbers, from the groups in the model, their rivals and the exact fit."""
    deviation = np.sqrt(np.diag(fit.covariance))
    kept: list[Kept] = []
    at = 0
    for g, variance in active.variances.items():
        own = slice(at, at + len(active.chosen[g]))
        at = own.stop
        group = active.pool.groups[g]
        pick = active.chosen[g].tolist()
        effects, spreads = tuple(group.effects[k] for k in pick), tuple(group.spreads[k] for k in pick)
        group = replace(group, effects=effects, spreads=spreads)
        others = tuple((active.pool.groups[r.number], r.loss) for r in rivals.get(g, ()))
        said = variance * active.own(g)[0]
        determined = float(np.sum(said / (1.0 + said)))
        gain = active.gains[g][0]
        kept.append(Kept(group, gain, variance, fit.point.theta[own], deviation[own], others, determined))
    geometry = tuple(k for k in kept if k.group.always_included)
    found = tuple(sorted((k for k in kept if not k.group.always_included), key=lambda k: -k.gain))
    return Selection(geometry, found, offered_groups, active.evidence, fit.sigma, fit, by_chance)
