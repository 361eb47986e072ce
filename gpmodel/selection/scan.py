"""Score every group given a model, or in the place of one of its groups."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray
from gpmodel.evidence.score import best, fitted, rotated
from gpmodel.selection.pool import SizeClass
from gpmodel.selection.posterior import Active

MEMORY = 4_000_000
"""Numbers held at once, 32 MB."""


def scan(active: Active, among: IntArray | None = None) -> tuple[Array, Array, Array]:
    """Compute gain (G,), best variance (G,) and decrease of yᵀC⁻¹y (G,) of every group given the model.

    among: groups to score; the gain of others is -∞.
    """
    pool = active.pool
    gains, variances = np.full(len(pool.groups), -np.inf), np.ones(len(pool.groups))
    fit = np.zeros(len(pool.groups))
    rows = None if among is None else np.unique(np.concatenate([pool.index[g] for g in among]))
    table, right = whitened_cross(active, rows)
    place = np.arange(len(pool.effects))
    if rows is not None:
        place[rows] = np.arange(len(rows))
    for c in pool.classes:
        at = np.arange(len(c.ids)) if among is None else np.flatnonzero(np.isin(c.ids, among))
        if len(at):
            s, q = rotated(*conditional_gram(active, c.part(at), table, right, place))
            ids = c.ids[at]
            gains[ids], variances[ids] = best(s, q, pool.cap[ids])
            fit[ids] = fitted(variances[ids], s, q)
    return gains, variances, fit


def whitened_cross(active: Active, rows: IntArray | None = None) -> tuple[Array, Array]:
    """Form the whitened cross products T = XᵀA L⁻ᵀ (E, K) of the model's columns with the distinct columns, and
    t = L⁻¹Aᵀy (K,)."""
    parts = []
    for g, a in active.variances.items():
        crossed = active.pool.crossed(g) if rows is None else active.pool.crossed(g)[rows]
        whole = len(active.chosen[g]) == crossed.shape[1]
        parts.append(np.sqrt(a) * (crossed if whole else crossed[:, active.chosen[g]]))
    table = linalg.blas.dtrmm(1.0, active.inverse, np.hstack(parts).T, lower=1, overwrite_b=1).T
    return table, active.inverse @ active.rhs


def conditional_gram(active: Active, c: SizeClass, table: Array, right: Array, place: IntArray) -> tuple[Array, Array]:
    """Compute S (G, K, K) and XᵀC⁻¹y (G, K) of the groups of one size given the model.

    place: row of the table of each distinct effect.
    """
    inner, rhs = c.inner / active.sigma2, c.rhs / active.sigma2
    for part in _chunks(c, table.shape[1]):
        t = table[place[c.index[part]]] * c.spreads[part][:, :, None]
        inner[part] -= (t @ np.swapaxes(t, 1, 2)) / active.sigma2
        rhs[part] -= (t @ right) / active.sigma2
    return inner, rhs


@dataclass(frozen=True)
class Replacements:
    """Gains of every group in the place of each selected one."""

    active: Active

    @cached_property
    def _whitened(self) -> tuple[Array, Array]:
        return whitened_cross(self.active)

    @cached_property
    def _beside(self) -> list[tuple[Array, Array]]:
        place = np.arange(len(self.active.pool.effects))
        return [conditional_gram(self.active, c, *self._whitened, place) for c in self.active.pool.classes]

    def of(self, g: int, least: Array) -> tuple[Array, Array]:
        """Compute gain (G,) and best variance (G,) of every group in the place of g; -∞ below `least` (G,).

        Taking g out: S gains u uᵀ / σ² with u = (XᵀA H)_g chol(H_gg)⁻ᵀ, XᵀC⁻¹y likewise. No gain exceeds
        ½ yᵀC⁻¹X S⁻¹ XᵀC⁻¹y, which is cheaper.
        """
        active, pool = self.active, self.active.pool
        table, right = self._whitened
        own = active.blocks[g]
        block = active.inverse[own.start :, own]
        root = linalg.cholesky(block.T @ block, lower=True, check_finite=False)
        back = linalg.solve_triangular(root, block.T, lower=True, check_finite=False)
        table, right = table[:, own.start :] @ back.T, back @ right[own.start :]
        gains, variances = np.full(len(pool.groups), -np.inf), np.ones(len(pool.groups))
        for c, (inner, rhs) in zip(pool.classes, self._beside, strict=True):
            for part in _chunks(c, table.shape[1]):
                t = table[c.index[part]] * c.spreads[part][:, :, None]
                s = inner[part] + (t @ np.swapaxes(t, 1, 2)) / active.sigma2
                q = rhs[part] + (t @ right) / active.sigma2
                able = np.flatnonzero(_bound(s, q) >= least[c.ids[part]])
                if len(able):
                    ids = c.ids[part[able]]
                    gains[ids], variances[ids] = best(*rotated(s[able], q[able]), pool.cap[ids])
        return gains, variances


def _chunks(c: SizeClass, width: int) -> list[IntArray]:
    """Divide the groups of a class into parts of bounded memory."""
    return np.array_split(np.arange(len(c.ids)), max(1, c.index.size * width // MEMORY))


def _bound(s: Array, q: Array) -> Array:
    """Compute ½ qᵀS⁻¹q (G,) of S (G, K, K), an upper bound of the gain."""
    size = s.shape[-1]
    ridge = 1e-12 * np.trace(s, axis1=1, axis2=2)[:, None, None] * np.eye(size) + 1e-300 * np.eye(size)
    return np.asarray(0.5 * np.einsum("gk,gk->g", q, np.linalg.solve(s + ridge, q[:, :, None])[:, :, 0]))
