"""Propose smooth terms of one or two inputs at any site for the residual of a model.

A smooth term of one input is a sum of sines with the prior variances of a Gaussian process
(``gpmodel.evolution.smooth``), a smooth term of two inputs a sum of products of sines. The marginal likelihood of a
smooth term given a model decides whether the residual at a site depends on the term's inputs, in whatever form.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, IntArray
from gpmodel.evidence.score import diagonalised, fitted, with_refitted_noise
from gpmodel.evolution.smooth import Sines
from gpmodel.evolution.variances import best
from gpmodel.families.candidate import SMOOTH_TERM, Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, axis_unit
from gpmodel.model.memory import read_by
from gpmodel.model.sites import Site
from gpmodel.selection.group import CAP, Group, Shapes, group_of
from gpmodel.selection.posterior import Active

LENGTHS: tuple[tuple[float, ...], ...] = ((0.35,), (0.9,), (0.6, 0.6), (0.6, 1.5), (1.5, 0.6), (1.2, 1.2))
"""Correlation lengths of smooth terms of one input and of two, relative to half the range of each input."""
SCREENED = 300
"""Largest number of poses in the screening of smooth terms; the selection uses all poses."""
SHORT_LIST, OFFERED, OF_ONE_PLACE = 40, 24, 4
"""Largest numbers of pairs of site and inputs scored exactly, of proposed smooth terms, and of terms at one site."""
COARSE, COMPONENTS = 0.6, 5
"""Correlation length, over half the input's range, and number of principal components in the screening."""
TYPICAL = 100.0
"""Ratio of the prior variance in the screening of smooth terms to the mean variance of an estimated coefficient."""
NEGLIGIBLE = 0.02
"""Relative prior standard deviation of a coefficient below which its product of sines is omitted."""


@dataclass(frozen=True)
class SmoothTerm:
    """A smooth term: sines of one input, or products of sines of two inputs.

    index: index of the sine of each input in each product.
    spreads: relative prior standard deviation of the coefficient of each product.
    """

    sines: tuple[Sines, ...]
    index: IntArray
    spreads: Array

    @staticmethod
    def of(sines: tuple[Sines, ...]) -> "SmoothTerm":
        """Return the smooth term with all products of sines whose prior standard deviation is not negligible."""
        grid = np.array(list(np.ndindex(*(len(w.rates) for w in sines))))
        spread = np.prod([w.spreads[grid[:, i]] for i, w in enumerate(sines)], axis=0)
        kept = spread > NEGLIGIBLE * spread.max()
        return SmoothTerm(sines, grid[kept], spread[kept])

    @property
    def inputs(self) -> tuple[str, ...]:
        return tuple(w.name for w in self.sines)

    def values(self) -> Array:
        """Return the products of sines at all poses, scaled so that their variances over the poses add up to 1."""
        parts = [w.values[:, self.index[:, i]] for i, w in enumerate(self.sines)]
        out = parts[0] if len(parts) == 1 else parts[0] * parts[1]
        return np.asarray(out / np.sqrt(out.var(axis=0).sum()))

    def group(self, site: Site, cost: float, shapes: Shapes) -> Group | None:
        """Return the smooth term as a group of effects at a site; None if it is constant. cost: penalty, nats."""
        name = f"{site.name} over {' and '.join(self.inputs)}"
        effects = []
        for number, (row, spread) in enumerate(zip(self.index.tolist(), self.spreads.tolist(), strict=True), 1):
            text = "*".join(w.text(k) for w, k in zip(self.sines, row, strict=True))
            terms = site.effect("", Expression(text), "").terms
            effects.append(Effect(f"{name}, {number}", terms, axis_unit(site.axis), "", spread))
        return group_of(Candidate(name, tuple(effects), "", cost, SMOOTH_TERM), shapes)


@lru_cache(64)
def principal(values: bytes) -> Array:
    """Compute the largest principal components of a Gaussian covariance of an input's values, for the screening."""
    column = np.frombuffer(values)
    u = 2.0 * (column - column.min()) / max(float(np.ptp(column)), np.finfo(float).tiny)
    sizes, turn = np.linalg.eigh(np.exp(-((u[:, None] - u) ** 2) / (2.0 * COARSE**2)))
    return np.asarray(turn[:, -COMPONENTS:] * np.sqrt(np.maximum(sizes[-COMPONENTS:], 0.0)))


def multiplied(parts: Sequence[Array]) -> Array:
    """Multiply every function of the first input with every one of the second input; omit negligible products."""
    out = parts[0] if len(parts) == 1 else (parts[0][:, :, None] * parts[1][:, None, :]).reshape(len(parts[0]), -1)
    size = out.std(axis=0)
    out = out[:, size > NEGLIGIBLE * size.max()]
    return np.asarray(out / np.sqrt(out.var(axis=0).sum()))


@dataclass(frozen=True)
class _Found:
    """A smooth term at a site, with its net log evidence gain and its penalty, nats."""

    nats: float
    cost: float
    site: Site
    function: SmoothTerm


def propose_smooth_terms(active: Active, sites: Sequence[Site], inputs: Sequence[str]) -> list[Group]:
    """Return the smooth terms of largest net gain given a model, at most a few at each site.

    For a term of two inputs a term of each input is proposed too, so that a sum is distinguished from a product.
    """
    out: dict[tuple[str, ...], _Found] = {}
    for f in sorted(_best(active, sites, inputs), key=lambda f: -f.nats):
        here = sum(key[0] == f.site.name for key in out)
        if f.nats > 0 and here < OF_ONE_PLACE and len(out) < OFFERED:
            out.setdefault((f.site.name, *f.function.inputs), f)
    cost = math.log(max(len(sites) * len(inputs), 1))
    for f in [f for f in out.values() if len(f.function.sines) > 1]:
        for one in f.function.sines:
            alone = _Found(0.0, cost, f.site, SmoothTerm.of((one,)))
            out.setdefault((f.site.name, one.name), alone)
    groups = (f.function.group(f.site, f.cost, active.pool.rows.shapes) for f in out.values())
    return [g for g in groups if g is not None]


def nats_without_a_name(active: Active, sites: Sequence[Site], inputs: Sequence[str], offered: int) -> Array:
    """Return net log evidence gains, nats, of smooth terms at some sites. offered: number of all candidate sites."""
    further = math.log(offered / len(sites)) + active.criteria.minimum_nats
    return np.array([found.nats - further for found in _best(active, sites, inputs)])


def _best(active: Active, sites: Sequence[Site], inputs: Sequence[str]) -> Iterator[_Found]:
    """Yield smooth terms at the sites and inputs of largest approximate gain, scored at every correlation length."""
    places = SiteProducts.of(active, sites)
    columns = {name: active.pool.rows.shapes.states[name][places.poses] for name in inputs}
    plain = [name for name in columns if not read_by(name)]
    asked: list[tuple[str, ...]] = [*((name,) for name in columns), *combinations(plain, 2)]
    coarse = {name: principal(np.asarray(column, float).tobytes()) for name, column in columns.items()}
    screened = [places.screened(multiplied([coarse[n] for n in names]), active.sigma2) for names in asked]
    likely = [divmod(k, len(sites)) for k in np.argsort(-np.array(screened), axis=None)[:SHORT_LIST].tolist()]
    for lengths in LENGTHS:
        there = [(asked[k], site) for k, site in likely if len(asked[k]) == len(lengths)]
        if not there:
            continue
        functions = [
            SmoothTerm.of(tuple(Sines.of(n, columns[n], length) for n, length in zip(names, lengths, strict=True)))
            for names, _ in there
        ]
        products = [
            places.products(function.values(), active.sigma2, slice(site, site + 1))
            for function, (_, site) in zip(functions, there, strict=True)
        ]
        size, turned = diagonalised(*(np.concatenate(part) for part in zip(*products, strict=True)))
        gains, variances = best(size, turned, np.full(len(there), CAP))
        gains = with_refitted_noise(gains, fitted(variances, size, turned), active.mismatch)
        alternatives = len(sites) * sum(len(names) == len(lengths) for names in asked)
        cost = math.log(alternatives * sum(len(some) == len(lengths) for some in LENGTHS))
        for function, (_, site), gain in zip(functions, there, gains.tolist(), strict=True):
            yield _Found(gain - cost - active.criteria.head_start, cost, sites[site], function)


@dataclass(frozen=True)
class SiteProducts:
    """Inner products, given a model, of the motion of the measured points by a unit twist at each site and pose.

    inner: products of the motions at two poses, by site, with the model projected out. rhs: those with the residual.
    """

    poses: IntArray
    inner: Array
    rhs: Array

    @cached_property
    def single(self) -> NDArray[np.float32]:
        """The inner products of twists in single precision, for the screening."""
        return self.inner.astype(np.float32)

    @staticmethod
    def of(active: Active, sites: Sequence[Site]) -> "SiteProducts":
        """Form the inner products of twists given a model, over all poses or a subset spread evenly along the rows."""
        rows = active.pool.rows
        at = np.unique(np.linspace(0, len(rows.present) - 1, min(SCREENED, len(rows.present))).astype(int))
        taken = np.hstack([rows.placement, active.spanned])
        left = rows.target - active.spanned @ (active.spanned.T @ rows.target)
        units = [sum(w * rows.sensitivity((slot, axis)) for slot, axis, w in site.terms) for site in sites]
        reach = rows.whitening.whiten(np.array(units).T)
        by_pose = rows.apart(np.column_stack([taken, left, reach]))[at]
        count = taken.shape[1]
        taken, left, reach = by_pose[:, :, :count], by_pose[:, :, [count]], by_pose[:, :, count + 1 :]
        sums = np.swapaxes(np.swapaxes(reach, 1, 2) @ taken, 0, 1)
        energy, rhs = (np.sum(reach * value, axis=1).T for value in (reach, left))
        inner = -(sums @ np.swapaxes(sums, 1, 2))
        inner[:, np.arange(len(at)), np.arange(len(at))] += energy
        return SiteProducts(rows.present[at], np.ascontiguousarray(inner), rhs)

    def products(self, values: Array, sigma2: float, some: slice = slice(None)) -> tuple[Array, Array]:
        """Return XᵀC⁻¹X and XᵀC⁻¹y at some sites. X: columns of basis functions `values`; C: covariance of y."""
        sites, poses, _ = self.inner[some].shape
        there = (self.inner[some].reshape(-1, poses) @ values).reshape(sites, poses, -1)
        return values.T @ there / sigma2, self.rhs[some] @ values / sigma2

    def screened(self, values: Array, sigma2: float) -> Array:
        """Return the gain of a smooth term at each site, nats, ½ a bᵀM⁻¹b - ½ ln|M|, for a typical prior variance a.

        M = I + a S; S = XᵀC⁻¹X and b = XᵀC⁻¹y are products of the columns X of the functions `values`. The last pivot
        of the Cholesky factor of M bordered by √a b and a number c is √(c - a bᵀM⁻¹b)."""
        sites, poses, size = *self.rhs.shape, values.shape[1]
        single = values.astype(np.float32)  # its rounding is 1e-7 of the energy before the model is projected out
        there = (self.single.reshape(-1, poses) @ single).reshape(sites, poses, -1)
        inner, rhs = (single.T @ there).astype(float) / sigma2, self.rhs @ values / sigma2
        energy = np.diagonal(self.inner, axis1=1, axis2=2) @ np.sum(values**2, axis=1) / sigma2
        variance = TYPICAL * size / np.maximum(np.trace(inner, axis1=1, axis2=2), 1e-3 * energy + 1e-300)
        border = np.sqrt(variance)[:, None] * rhs
        corner = 1.0 + np.sum(border**2, axis=1)
        bordered = np.zeros((len(inner), size + 1, size + 1))
        bordered[:, :-1, :-1] = np.eye(size) + variance[:, None, None] * inner
        bordered[:, -1, :-1], bordered[:, -1, -1] = border, corner
        pivots = np.diagonal(np.linalg.cholesky(bordered), axis1=1, axis2=2)
        return np.asarray(0.5 * (corner - pivots[:, -1] ** 2) - np.log(pivots[:, :-1]).sum(axis=1))
