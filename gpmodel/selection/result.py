"""Summarise a selection: groups with gains and alternatives, and what it would select by chance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauge import of_one_fold
from gpmodel.evidence.residual import exchangeable, reordered
from gpmodel.evidence.score import best
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.numerics import rank as ident
from gpmodel.selection.active import Active
from gpmodel.selection.group import Group
from gpmodel.selection.look import Expansion, Look, Screening
from gpmodel.selection.offers import shared_kinds
from gpmodel.selection.pool import Rows
from gpmodel.selection.scan import conditional_gram, whitened_cross
from gpmodel.selection.waves import most_by_chance
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
        """Return the offer with formulas of some curves; these curves pay a reading price from then on."""
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
    """Summarise the selected groups and their alternatives."""
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


MOST_NUMBERS = 1_000_000
"""Entries of a class's gain matrices, times the residuals, that are worked on at once: some ten megabytes."""


def best_by_chance(
    active: Active, grids: Sequence[FrequencyGrid], bundle: IntArray, rng: np.random.Generator, count: int
) -> Array:
    """The most nats (count,), costs counted, that any group or wave gains on each of `count` permuted residuals.

    bundle: (N,) code of the poses that stay together, in the order of the problem's poses. Every group is
    scored beside the model on the permuted residuals as in `scan`.
    """
    pool, trials = active.pool, active.pool.rows.clean(permuted(active, bundle, rng, count))
    every_rhs = pool.atoms.cross(trials)
    table, _ = whitened_cross(active)
    rights = active.inverse @ (active.scale[:, None] * every_rhs[active.index])
    place, found = np.arange(len(pool.effects)), most_by_chance(active, grids, trials)
    for c in pool.classes:
        inner, _ = conditional_gram(active, c, table, np.zeros(table.shape[1]), place)
        s, turn = np.linalg.eigh(inner)
        reach = table[c.index] * c.spreads[:, :, None]
        for some in np.array_split(np.arange(count), -(-count * turn.size // MOST_NUMBERS)):
            rhs = every_rhs[c.index][:, :, some] * c.spreads[:, :, None] - reach @ rights[:, some]
            q = np.einsum("gkt,gkl->tgl", rhs / active.sigma2, turn)
            found[some] = with_the_best(found[some], s, q, pool.cap[c.ids], pool.cost[c.ids])
    return found


def with_the_best(found: Array, s: Array, q: Array, cap: Array, cost: Array) -> Array:
    """The most nats (T,) that were found, or that any of G groups gains, its cost counted, where that is more.

    s: (G, K), q: (T, G, K). No gain exceeds ½ Σ q² / s: the variance is sought of the group for which that is largest
    on each trial, then of those alone that could still gain more.
    """
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        most = 0.5 * np.sum(np.where(q == 0.0, 0.0, q**2 / np.maximum(s, 0.0)), axis=2) - cost
    first = np.arange(len(q)), np.argmax(most, axis=1)
    found = np.maximum(found, best(s[first[1]], q[first], cap[first[1]])[0] - cost[first[1]])
    trial, group = np.nonzero(most > found[:, None])
    np.maximum.at(found, trial, best(s[group], q[trial, group], cap[group])[0] - cost[group])
    return found


def permuted(active: Active, bundle: IntArray, rng: np.random.Generator, count: int) -> Array:
    """Targets (M, count), whitened: what the model explains, and the rest in another order of the bundles.

    The rest is made as large as the noise σ of the model: the fit has taken a part of the noise, of few poses a large
    one, and takes that part again of every permuted residual. What places a body that one bundle alone touched, a bar,
    takes five sixths of a residual once: what is left of another bar has nothing more for it to take.
    """
    rows, left = active.pool.rows, active.left
    codes = np.unique(bundle, return_inverse=True)[1].reshape(-1)
    turned = reordered(rows.problem, left, codes, rng, count)
    energy, size = max(active.energy, np.finfo(float).tiny), float(len(left))
    own = _of_one_bundle(rows, codes)
    if own.shape[1]:
        taken = float(np.mean(np.sum((own.T @ turned) ** 2, axis=0)))
        size = (size - own.shape[1]) / max(1.0 - taken / energy, 1.0 / size)
    return (rows.target - left)[:, None] + turned * float(np.sqrt(active.sigma2 * size / energy))


def _of_one_bundle(rows: Rows, codes: IntArray) -> Array:
    """Orthonormal columns (M, k) of what is placed by poses of one bundle alone; codes: (N,) of the poses."""
    placed = rows.problem.columns[:, : rows.problem.placement]
    alone = of_one_fold(placed, codes[rows.pose_of_row])
    return ident.orthonormal(rows.whitening.whiten(placed[:, alone]))
