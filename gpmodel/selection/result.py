"""Result of a selection: groups with gains, and the distribution of the largest gain by chance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.gauge import nonzero_in_one_fold
from gpmodel.evidence.residual import exchangeable_blocks
from gpmodel.evolution.variances import best
from gpmodel.families.frequency_grid import FrequencyGrid
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.numerics import rank as ident
from gpmodel.selection.group import Group
from gpmodel.selection.offers import shared_kinds
from gpmodel.selection.pool import Rows
from gpmodel.selection.posterior import Active
from gpmodel.selection.relinearise import Expansion, Screening
from gpmodel.selection.scan import Scan
from gpmodel.selection.sinusoids import sinusoid_null
from gpmodel.selection.sparse_bayes import reestimate
from gpmodel.table.blocks import FOLD_SEED


@dataclass(frozen=True)
class Kept:
    """A group of effects that the selection has added to the model.

    gain: log evidence of the model minus the log evidence without the group, penalty not subtracted, nats.
    variance: prior variance of the group's coefficients.
    determined: effective number of the group's coefficients that the data determine.
    shared: part of the group's penalty that another selected group of that kind pays already, nats.
    """

    group: Group
    gain: float
    variance: float
    determined: float = 0.0
    shared: float = 0.0

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects of the selected group with prior standard deviations that the selection has estimated."""
        return self.group.with_prior(self.variance)


@dataclass(frozen=True)
class Offered:
    """The groups of effects that a selection may use.

    always: groups that are always in the model. single: groups of the catalogue and evolved groups. proposed: smooth
    terms, sinusoids and formulas proposed for a residual. grids: frequency grids of sinusoids.
    """

    screening: Screening
    always: tuple[Group, ...]
    single: tuple[Group, ...]
    proposed: tuple[Group, ...]
    grids: Sequence[FrequencyGrid]

    def with_formulas_of(self, curves: frozenset[str]) -> "Offered":
        """Mark smooth terms for which formulas are candidates too; the marked smooth terms get a higher penalty."""
        prices = self.screening.prices
        prices = replace(prices, with_formulas=prices.with_formulas | curves)
        return replace(self, screening=replace(self.screening, prices=prices))

    def groups(self, mechanism: Mechanism) -> list[Group]:
        """Return all candidate groups of effects, with joint groups for each kind of effect at several joints."""
        return [*self.always, *self.single, *shared_kinds(mechanism, self.single), *self.proposed]


@dataclass(frozen=True)
class Selection:
    """Groups of effects that were selected, and the model that contains the groups.

    kept: selected groups in order of decreasing gain.
    offered: groups that were candidates.
    active: linear model with the posterior of the selected groups.
    state: fit of the exact kinematic chain with the selected groups.
    """

    kept: tuple[Kept, ...]
    offered: Offered
    active: Active
    state: Expansion

    @property
    def names(self) -> frozenset[str]:
        """Names of the selected groups of effects."""
        return frozenset(kept.group.name for kept in self.kept)

    def null_without(self, name: str = "") -> Array:
        """Return the largest net gain, nats, of any group on residuals of the model without a group, with random signs.

        name: name of the group, which may have absorbed the largest noise; empty for the model with all groups.
        """
        limits, rng = self.offered.screening.prices.limits, np.random.default_rng(FOLD_SEED)
        together = exchangeable_blocks(self.state.fitting.poses.dataset, limits)
        without = [g for g in self.active.found if self.active.pool.groups[g].name == name]
        active = reestimate(self.active.without(without[0])) if without else self.active
        return gain_null(active, self.offered.grids, together, rng, limits.shuffles)


def summarised(offered: Offered, active: Active, state: Expansion) -> Selection:
    """Summarise a selection as its result.

    An effect that several groups share belongs to the group of largest gain; its prior variance is the sum over these
    groups. A group of which all effects belong to other groups is omitted.
    """
    pool, kept, total = active.pool, list[Kept](), np.zeros(len(active.pool.effects))
    for g, variance in active.variances.items():
        total[pool.index[g][active.chosen[g]]] += variance * pool.spreads[g][active.chosen[g]] ** 2
    owned = {k for g in active.variances.keys() - {*active.found} for k in pool.index[g][active.chosen[g]].tolist()}
    for g in sorted(active.found, key=lambda g: -active.gains[g][0]):
        group, variance = pool.groups[g], active.variances[g]
        pick = [k for k in active.chosen[g].tolist() if pool.index[g][k] not in owned]
        owned.update(pool.index[g][pick].tolist())
        effects, spreads = tuple(group.effects[k] for k in pick), np.sqrt(total[pool.index[g][pick]] / variance)
        said = variance * active.own(g)[0]
        determined = float(np.sum(said / (1.0 + said)))
        shared = float(pool.price[g] - active.prices[g])
        if pick:
            group = replace(group, effects=effects, spreads=tuple(spreads.tolist()))
            kept.append(Kept(group, active.gains[g][0], variance, determined, shared))
    return Selection(tuple(kept), offered, active, state)


MOST_NUMBERS = 1_000_000
"""Largest number of products of groups of effects with random residuals in memory at once: some ten megabytes."""


def gain_null(
    active: Active, grids: Sequence[FrequencyGrid], block: IntArray, rng: np.random.Generator, count: int
) -> Array:
    """Compute the largest gain minus description penalty, nats, of any group or sinusoid on each random residual.

    Every group of effects is scored as an addition to the model `active`. block: index of the exchangeable block of
    each pose. count: number of random residuals.
    """
    pool, trials = active.pool, active.pool.rows.clean(with_random_signs(active, block, rng, count))
    every_rhs = pool.atoms.cross(trials)
    products, found = Scan(active), sinusoid_null(active, grids, trials)
    rights = active.inverse @ (active.scale[:, None] * every_rhs[active.index])
    for c, inner, _ in products.classes:
        s, turn = np.linalg.eigh(inner)
        reach = products.table[c.index] * c.spreads[:, :, None]
        for some in np.array_split(np.arange(count), -(-count * turn.size // MOST_NUMBERS)):
            rhs = every_rhs[c.index][:, :, some] * c.spreads[:, :, None] - reach @ rights[:, some]
            q = np.einsum("gkt,gkl->tgl", rhs / active.sigma2, turn)
            found[some] = running_maximum(found[some], s, q, pool.cap[c.ids], pool.cost[c.ids])
    return found


def running_maximum(found: Array, s: Array, q: Array, cap: Array, cost: Array) -> Array:
    """Raise the largest net gain `found` of each random residual, nats, to the largest net gain of any group.

    s: eigenvalues of each group's XᵀC⁻¹X = V diag(s) Vᵀ. q: VᵀXᵀC⁻¹r for each residual r. No gain exceeds the bound ½
    Σ q² / s. The exact gain is computed for the group of largest bound, then for groups whose bound exceeds this gain.
    """
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        most = 0.5 * np.sum(np.where(q == 0.0, 0.0, q**2 / np.maximum(s, 0.0)), axis=2) - cost
    first = np.arange(len(q)), np.argmax(most, axis=1)
    found = np.maximum(found, best(s[first[1]], q[first], cap[first[1]])[0] - cost[first[1]])
    trial, group = np.nonzero(most > found[:, None])
    np.maximum.at(found, trial, best(s[group], q[trial, group], cap[group])[0] - cost[group])
    return found


def with_random_signs(active: Active, block: IntArray, rng: np.random.Generator, count: int) -> Array:
    """Return the model's prediction plus residuals with random signs of the blocks, whitened, by trial.

    Unlike a permutation, random signs keep the size and the direction of the noise of each pose: the noise of a joint
    is largest where the lever is longest, as is the effect of the joint. Residuals are rescaled to the noise σ, because
    the fit removed degrees of freedom and removes them again, except the columns of a body that one block alone
    measures, such as a bar. block: block index of each pose. Source: Liu (1988), wild bootstrap.
    """
    rows, left = active.pool.rows, active.left
    codes = np.unique(block, return_inverse=True)[1].reshape(-1)
    signs = rng.choice([-1.0, 1.0], (int(codes.max()) + 1, count))[codes[rows.pose_of_row]]
    size = len(left) - _of_one_block(rows, codes).shape[1]
    scale = float(np.sqrt(active.sigma2 * size / max(active.energy, np.finfo(float).tiny)))
    return (rows.target - left)[:, None] + scale * signs * left[:, None]


def _of_one_block(rows: Rows, codes: IntArray) -> Array:
    """Return a basis of the registration columns that one block of poses alone determines. codes: block of a pose."""
    placed = rows.problem.columns[:, : rows.problem.placement]
    alone = nonzero_in_one_fold(placed, codes[rows.pose_of_row])
    return ident.orthonormal(rows.whitening.whiten(placed[:, alone]))
