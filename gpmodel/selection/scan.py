"""Score every group given a model, or in the place of one of its groups."""

from collections.abc import Iterable

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray
from gpmodel.evidence.score import fitted, rotated, with_own_noise
from gpmodel.evolution.variances import best
from gpmodel.selection.pool import SizeClass
from gpmodel.selection.posterior import Active

MEMORY = 4_000_000
"""Numbers held at once, 32 MB."""
FREE = 1e4
"""Factor on the variance of a group of few unknowns, at which its prior holds it no more."""


class Scan:
    """Score groups given a model: what each gains when it is added, or when it replaces selected groups.

    table, right: whitened products T = XᵀA L⁻ᵀ (E, K) of the distinct columns with those of the model, and t = L⁻¹Aᵀy.
    classes: S (G, K, K) and XᵀC⁻¹y (G, K) of the groups of each size. among: groups to score; the gain of others is -∞.
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
        for part in _chunks(c, self.table.shape[1]):
            t = self._scaled(self.table, c, part)
            inner[part] -= (t @ np.swapaxes(t, 1, 2)) / self.active.sigma2
            rhs[part] -= (t @ self.right) / self.active.sigma2
        return inner, rhs

    def _scaled(self, table: Array, c: SizeClass, part: IntArray) -> Array:
        """Rows (G, K, ...) of a table for some groups of a class, times their spreads."""
        return np.asarray(table[self.place[c.index[part]]] * c.spreads[part][:, :, None])

    def gains(
        self, least: Array | None = None, removed: Iterable[int] = (), freed: Iterable[int] = (), scaled: bool = False
    ) -> tuple[Array, Array, Array]:
        """Compute gain (G,), best variance (G,) and decrease of yᵀC⁻¹y (G,) of every group without the removed ones.

        least: (G,) gain below which an upper bound is returned. freed: groups whose variances are multiplied by `FREE`.
        scaled: the noise and all variances are multiplied by what makes yᵀC⁻¹y the degrees of freedom.
        With columns A_D whose variances become 1 + δ times what they were (0: removed):
        S' = S - W M⁻¹ Wᵀ,  W = XᵀA H_D,  M = 1/δ + I - σ² H_DD; XᵀC⁻¹y and yᵀC⁻¹y likewise.
        """
        active, pool = self.active, self.active.pool
        change = {**dict.fromkeys(freed, FREE - 1.0), **dict.fromkeys(removed, -1.0)}
        columns = [np.arange(len(active.rhs))[active.blocks[g]] for g in change]
        delta = np.repeat(list(change.values()), [len(at) for at in columns])
        at = np.concatenate([np.zeros(0, np.int64), *columns])
        start = int(at.min(initial=len(active.rhs)))
        below = active.inverse[start:, at]
        m, turn = np.linalg.eigh(np.diag(1.0 / delta + 1.0) - active.sigma2 * below.T @ below)
        table, right = self.table[:, start:] @ (below @ turn), active.mean[at] @ turn
        mismatch = active.mismatch - float(np.sum(right**2 / m))
        scale, gains = mismatch / pool.rows.freedom if scaled else 1.0, np.full(len(pool.groups), -np.inf)
        variances, fit = np.ones(len(pool.groups)), np.zeros(len(pool.groups))
        for c, inner, rhs in self.classes:
            for part in _chunks(c, table.shape[1]):
                t = self._scaled(table, c, part)
                s = (inner[part] - (t / m) @ np.swapaxes(t, 1, 2)) / scale
                q = (rhs[part] - t @ (right / m)) / scale
                ids = c.ids[part]
                some = np.full(len(ids), -np.inf) if least is None else least[ids]
                gains[ids], variances[ids], fit[ids] = _gains(s, q, pool.cap[ids], mismatch / scale, some)
        return gains, variances, fit


def _gains(inner: Array, rhs: Array, cap: Array, mismatch: float, least: Array) -> tuple[Array, Array, Array]:
    """Compute gain (G,), best variance (G,) and decrease of yᵀC⁻¹y (G,) of S (G, K, K) and XᵀC⁻¹y (G, K).

    Where no gain reaches `least` (G,), even with the noise estimated again: its upper bound ½ yᵀC⁻¹X S⁻¹ XᵀC⁻¹y.
    """
    ridge = (1e-12 * np.trace(inner, axis1=1, axis2=2)[:, None, None] + 1e-300) * np.eye(inner.shape[-1])
    gains = 0.5 * np.sum(rhs * np.linalg.solve(inner + ridge, rhs[:, :, None])[:, :, 0], axis=1)
    variances, fit = np.ones(len(rhs)), np.zeros(len(rhs))
    able = with_own_noise(gains, 2.0 * gains, mismatch) >= least
    if able.any():
        s, q = rotated(inner[able], rhs[able])
        gains[able], variances[able] = best(s, q, cap[able])
        fit[able] = fitted(variances[able], s, q)
    return gains, variances, fit


def _chunks(c: SizeClass, width: int) -> list[IntArray]:
    """Divide the groups of a class into parts of bounded memory."""
    return np.array_split(np.arange(len(c.ids)), max(1, c.index.size * width // MEMORY))
