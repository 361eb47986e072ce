"""Score every group of effects as an addition to a model, and fix the prior variances of groups with many effects."""

from collections.abc import Iterable
from copy import copy
from dataclasses import replace

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray
from gpmodel.evidence.score import diagonalised, fitted, with_refitted_noise
from gpmodel.evolution.variances import best
from gpmodel.selection.group import FEW
from gpmodel.selection.pool import GroupPool, SizeClass
from gpmodel.selection.posterior import Active

MEMORY = 4_000_000
"""Largest number of values in memory at once in a scan of candidate groups: 32 MB."""


class Scan:
    """Compute the gain in log evidence, nats, of adding each candidate group of effects to a model.

    table: products of all candidate columns with the model's columns, whitened. classes: products XᵀC⁻¹X and XᵀC⁻¹y of
    the columns X of groups with equally many effects. among: groups to score; the gain of others is set to -∞.
    """

    def __init__(self, active: Active, among: IntArray | None = None) -> None:
        self.active, pool = active, active.pool
        classes, rows, self.place = pool.classes, None, np.arange(len(pool.effects))
        if among is not None:
            rows = np.unique(np.concatenate([pool.index[g] for g in among]))
            self.place[rows] = np.arange(len(rows))
            listed = np.isin(np.arange(len(pool.groups)), among)
            classes = tuple(c.part(np.flatnonzero(listed[c.ids])) for c in classes if listed[c.ids].any())
        self.table, self.right = self._whitened(rows), active.inverse @ active.rhs
        self.classes = [(c, *self._given_model(c)) for c in classes]

    def _whitened(self, rows: IntArray | None) -> Array:
        parts = []
        for g, a in self.active.variances.items():
            crossed = self.active.pool.crossed(g) if rows is None else self.active.pool.crossed(g)[rows]
            whole = len(self.active.chosen[g]) == crossed.shape[1]
            parts.append(np.sqrt(a) * (crossed if whole else crossed[:, self.active.chosen[g]]))
        table = linalg.blas.dtrmm(1.0, self.active.inverse, np.hstack(parts).T, lower=1, overwrite_b=1)
        return np.asarray(table.T)

    def _given_model(self, c: SizeClass) -> tuple[Array, Array]:
        inner, rhs = c.inner / self.active.sigma2, c.rhs / self.active.sigma2
        parts = max(1, c.index.size * self.table.shape[1] // MEMORY)
        for part in np.array_split(np.arange(len(c.ids)), parts):
            t = self.table[self.place[c.index[part]]] * c.spreads[part][:, :, None]
            inner[part] -= (t @ np.swapaxes(t, 1, 2)) / self.active.sigma2
            rhs[part] -= (t @ self.right) / self.active.sigma2
        return inner, rhs

    def gains(self, least: Array | None = None) -> tuple[Array, Array, Array]:
        """Return log evidence gain, nats, best prior variance, and decrease of yᵀC⁻¹y of every candidate group.

        The bound ½ yᵀC⁻¹X S⁻¹ XᵀC⁻¹y, S = XᵀC⁻¹X, replaces the gain of a group if the bound, with re-estimated noise,
        is below `least`, nats. X: columns of the group. C: covariance of the target y.
        """
        pool, gains, mismatch = self.active.pool, np.full(len(self.active.pool.groups), -np.inf), self.active.mismatch
        variances, fit = np.ones(len(gains)), np.zeros(len(gains))
        for c, inner, rhs in self.classes:
            ridge = (1e-12 * np.trace(inner, axis1=1, axis2=2)[:, None, None] + 1e-300) * np.eye(inner.shape[-1])
            bound = 0.5 * np.sum(rhs * np.linalg.solve(inner + ridge, rhs[:, :, None])[:, :, 0], axis=1)
            some = -np.inf if least is None else least[c.ids]
            gains[c.ids], able = bound, np.flatnonzero(with_refitted_noise(bound, 2.0 * bound, mismatch) >= some)
            (s, q), ids = diagonalised(inner[able], rhs[able]), c.ids[able]
            gains[ids], variances[ids] = best(s, q, pool.cap[ids])
            fit[ids] = fitted(variances[ids], s, q)
        return gains, variances, fit


class PoolBeside(GroupPool):
    """Candidate groups given other groups whose prior variance is fixed in units of the noise variance.

    The groups of fixed variance are projected out: products uᵀv become σ² uᵀC⁻¹v, with their covariance C.
    """

    def __init__(self, held: Active) -> None:
        vars(self).update(vars(held.pool))
        self.held, pool, scan = held, held.pool, Scan(held)
        self._table, self.rows = scan.table, copy(pool.rows)
        self.rows.target, self.square = held.left, held.sigma2 * held.mismatch
        self.rhs = pool.rhs - scan.table @ scan.right
        self.classes = tuple(replace(c, inner=held.sigma2 * s, rhs=held.sigma2 * q) for c, s, q in scan.classes)
        self.price = pool.price.copy()
        self.price[list(held.variances)] = np.inf
        volume = 2.0 * np.sum(np.log(np.diag(held.lower))) - len(held.rhs) * np.log(held.sigma2)
        self.constant = -held.paid - 0.5 * float(volume)
        self.reading_held, self.kinds_held = float(pool.reading[list(held.found)].sum()), held.of_kind
        self._nothing_formed()

    def _crossed_with(self, g: int) -> Array:
        return self.held.pool.crossed(g) - self._table @ (self.spreads[g][:, None] * self._table[self.index[g]]).T

    def _cleaned(self, g: int) -> Array:
        columns = self.held.pool.columns(g)
        return columns - self.held.spanned @ (self.held.spanned.T @ columns)


def beside_curves(model: Active, moving: Iterable[int], pools: dict[frozenset[int], GroupPool]) -> Active:
    """Fix the prior variances of groups with many coefficients, except groups in `moving`. pools: cache."""
    held = frozenset(g for g in model.found if model.pool.sizes[g] > FEW) - frozenset(moving)
    if not held:
        return model
    if held not in pools:
        pools[held] = PoolBeside(_part(model, held, model.pool))
    return _part(model, model.variances.keys() - held, pools[held])


def whole(model: Active) -> Active:
    """Return the model with free prior variances of all its groups, including groups with a fixed variance."""
    if not isinstance(model.pool, PoolBeside):
        return model
    held, units = model.pool.held, model.sigma2 / model.pool.held.sigma2
    variances = {g: units * a for g, a in held.variances.items()}
    return Active(held.pool, variances | model.variances, held.chosen | model.chosen, model.sigma2)


def _part(model: Active, groups: Iterable[int], pool: GroupPool) -> Active:
    """Return a model reduced to some of its groups of effects, with candidates `pool`."""
    own = sorted(groups)
    return Active(pool, {g: model.variances[g] for g in own}, {g: model.chosen[g] for g in own}, model.sigma2)
