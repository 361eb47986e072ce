"""Posterior of the groups in a model, log evidence of the model, and gain of each group.

With A (M, K) the columns of the selected groups times √a, C = σ² I + A Aᵀ and H = (σ² I + AᵀA)⁻¹ = L⁻ᵀL⁻¹: C⁻¹ = (I - A
H Aᵀ) / σ², so that S and q of any group need only the products XᵀA.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray
from gpmodel.evidence.criteria import Criteria
from gpmodel.evolution.variances import DECADES, best
from gpmodel.selection.group import FEW, Group
from gpmodel.selection.pool import GroupPool

LEAST_NOISE = 1e-8
"""Least noise of one coordinate, m: a tenth of an instrument's resolution. In an exact table less is rounding."""
LEAST = 10.0**-DECADES
"""Least ratio of the prior variance of a group to its largest allowed variance. A group that explains nothing reaches
this least variance, and is deleted."""


@dataclass(frozen=True)
class Active:
    """Groups in the model by index, with their prior variances. chosen: indices of the group's effects in the model."""

    pool: GroupPool
    variances: dict[int, float]
    chosen: dict[int, IntArray]
    sigma2: float

    @property
    def criteria(self) -> Criteria:
        """Limits for adding and deleting groups, see `Criteria`."""
        return self.pool.prices.limits

    def added(self, g: int, variance: float, part: Sequence[int] | None = None) -> "Active":
        """Return the model with group g at a prior variance. part: effects to add; None for all effects."""
        effects = np.arange(len(self.pool.index[g]))[slice(None) if part is None else part]
        return replace(self, variances={**self.variances, g: variance}, chosen={**self.chosen, g: effects})

    def beside(self, group: Group, variance: float) -> "Active":
        """Return the model with a new group, where no other group is a candidate."""
        pool = GroupPool(self.pool.rows, [*(self.pool.groups[g] for g in self.variances), group], self.pool.prices)
        variances = dict(enumerate(self.variances.values()))
        there = Active(pool, variances, dict(enumerate(self.chosen.values())), self.sigma2)
        return there.added(len(variances), variance)

    def without(self, g: int) -> "Active":
        """Return the model without group g."""
        left = {k: v for k, v in self.variances.items() if k != g}
        return replace(self, variances=left, chosen={k: v for k, v in self.chosen.items() if k != g})

    @cached_property
    def pools(self) -> dict[frozenset[int], GroupPool]:
        """Sets of candidate groups formed for this model, by the set of groups with fixed variance."""
        return {}

    @cached_property
    def blocks(self) -> dict[int, slice]:
        """Slice of the columns that belong to each group of the model."""
        out, at = {}, 0
        for g in self.variances:
            out[g] = slice(at, at + len(self.chosen[g]))
            at = out[g].stop
        return out

    @cached_property
    def index(self) -> IntArray:
        """Index of the distinct effect (K,) that belongs to each column."""
        return np.concatenate([self.pool.index[g][self.chosen[g]] for g in self.variances])

    @cached_property
    def scale(self) -> Array:
        """Prior standard deviation (K,) √a spread of the coefficient of each column."""
        roots = [np.sqrt(a) * self.pool.spreads[g][self.chosen[g]] for g, a in self.variances.items()]
        return np.concatenate(roots)

    @cached_property
    def inner(self) -> Array:
        """Inner products AᵀA (K, K) of the columns of the model, scaled by √a."""
        root = np.sqrt(np.repeat(list(self.variances.values()), [len(c) for c in self.chosen.values()]))
        return np.asarray(root[:, None] * self.pool.gram(self.chosen) * root)

    @cached_property
    def rhs(self) -> Array:
        """Inner products Aᵀy (K,) of the columns of the model, scaled by √a, with the target y."""
        return self.scale * self.pool.rhs[self.index]

    @cached_property
    def lower(self) -> Array:
        """Cholesky factor L (K, K) of σ² I + AᵀA, with the rounding error of the products added to the diagonal."""
        count = len(self.rhs)
        rounding = count * np.finfo(float).eps * float(np.max(np.diag(self.inner), initial=0.0))
        regular = np.array(self.inner, order="F")
        np.fill_diagonal(regular, np.diag(regular) + self.sigma2 + rounding)
        return np.asarray(linalg.cholesky(regular, lower=True, overwrite_a=True, check_finite=False))

    @cached_property
    def inverse(self) -> Array:
        """Inverse L⁻¹ (K, K) of the Cholesky factor."""
        return np.asarray(linalg.lapack.dtrtri(self.lower, lower=1)[0])

    @cached_property
    def spanned(self) -> Array:
        """Basis B = A L⁻ᵀ (M, K) of the groups of the model. B Bᵀ projects rows onto the span of the groups."""
        columns = [np.sqrt(a) * self.pool.columns(g)[:, self.chosen[g]] for g, a in self.variances.items()]
        return np.hstack(columns) @ self.inverse.T

    @cached_property
    def mean(self) -> Array:
        """Posterior mean H Aᵀy (K,) of the coefficients, in units of `scale`."""
        return self.inverse.T @ (self.inverse @ self.rhs)

    @cached_property
    def left(self) -> Array:
        """Residual (M,) of the model, whitened."""
        left = self.pool.rows.target.copy()
        for g, at in self.blocks.items():
            left -= self.pool.columns(g)[:, self.chosen[g]] @ (np.sqrt(self.variances[g]) * self.mean[at])
        return left

    @property
    def energy(self) -> float:
        """Sum of squares of the residual: |y|² - yᵀAμ - σ² |μ|², as (σ² I + AᵀA) μ = Aᵀy."""
        taken = self.mean @ (self.rhs + self.sigma2 * self.mean) if self.variances else 0.0
        return float(self.pool.square - taken)

    @cached_property
    def misfit(self) -> Array:
        """Sum of squares (P,) of the residual of each pose, whitened, in units of σ²."""
        return np.bincount(self.pool.rows.pose_of_row, self.left**2) / self.sigma2

    @property
    def unknowns(self) -> float:
        """Number γ of coefficients that the data determine."""
        return len(self.mean) - self.sigma2 * float(np.sum(self.inverse**2))

    @cached_property
    def mismatch(self) -> float:
        """Sum of squares yᵀC⁻¹y of the target y, weighted by its marginal covariance C."""
        return (self.pool.square - float(np.sum((self.inverse @ self.rhs) ** 2))) / self.sigma2

    @cached_property
    def evidence(self) -> float:
        """Log marginal likelihood of the target, registration and tool projected out, nats."""
        freedom, count = self.pool.rows.freedom, len(self.rhs)
        volume = (freedom - count) * float(np.log(self.sigma2)) + 2.0 * float(np.sum(np.log(np.diag(self.lower))))
        return -0.5 * (volume + self.mismatch + freedom * float(np.log(2 * np.pi)))

    def own(self, g: int, part: IntArray | slice = slice(None)) -> tuple[Array, Array]:
        """Return eigenvalues s and products q (1, K) of a group in the model, or of a part, given the others."""
        at = np.arange(self.blocks[g].start, self.blocks[g].stop)[part]
        return self._taken_out(at[None], np.array([self.variances[g]]))

    def _taken_out(self, at: IntArray, a: Array) -> tuple[Array, Array]:
        """Return eigenvalues s and products q (G, K) of columns (G, K) at prior variances (G,), each given the others.

        With σ²H_gg = V diag(h) Vᵀ and μ the posterior mean: a s = (1 - h) / h, √a q = Vᵀμ / h.
        """
        halves = (self.inverse[own[0] :, own] for own in at)
        h, turn = np.linalg.eigh(self.sigma2 * np.array([half.T @ half for half in halves]))
        h = np.clip(h, 1e-15, 1.0)
        turned = np.matmul(self.mean[at][:, None, :], turn)[:, 0]
        return (1.0 - h) / h / a[:, None], turned / h / np.sqrt(a)[:, None]

    @cached_property
    def gains(self) -> dict[int, tuple[float, float]]:
        """Gain of each group in the model over the model without the group, and its best prior variance."""
        return self._gains(np.arange(len(self.variances)))

    def _gains(self, of: IntArray) -> dict[int, tuple[float, float]]:
        """Return gains and best prior variances of some groups in the model, by their position in the model.

        Small groups are padded with columns of zeros, which gain nothing.
        """
        groups, a = np.array(list(self.variances), dtype=np.int64), np.array(list(self.variances.values()))
        first, sizes = self._columns
        s, q = np.zeros((2, len(groups), sizes[of].max(initial=0)))
        for size in np.unique(sizes[of]):
            of_it = of[sizes[of] == size]
            columns = first[of_it, None] + np.arange(size)
            s[of_it, :size], q[of_it, :size] = self._taken_out(columns, a[of_it])
        gains, at = best(s[of], q[of], self.pool.cap[groups[of]])
        return dict(zip(groups[of].tolist(), zip(gains.tolist(), at.tolist(), strict=True), strict=True))

    @cached_property
    def _columns(self) -> tuple[IntArray, IntArray]:
        """First column of each group, and number of columns of each group."""
        first = np.array([own.start for own in self.blocks.values()], dtype=np.int64)
        return first, np.diff(first, append=len(self.rhs))

    @cached_property
    def reestimated(self) -> dict[int, float]:
        """Prior variance a of each group for the next step: the best one for one or two columns, else a |μ|² / γ.

        MacKay's γ = K - σ² tr H_gg is the number of the K coefficients that the data determine. The update a |μ|² / γ
        needs no eigenvalues, and is stationary at the largest evidence.
        """
        (first, sizes), determined = self._columns, 1.0 - self.sigma2 * np.sum(self.inverse**2, axis=0)
        known, squares = (np.add.reduceat(part, first) for part in (determined, self.mean**2))
        a, most = np.array(list(self.variances.values())), self.pool.cap[list(self.variances)] ** 2
        a = np.clip(a * squares / np.maximum(known, 1e-9), LEAST * most, most)
        out = dict(zip(self.variances, a.tolist(), strict=True))
        return out | {g: variance for g, (_, variance) in self._gains(np.flatnonzero(sizes <= FEW)).items()}

    @cached_property
    def found(self) -> tuple[int, ...]:
        """Indices of the selected groups: all groups that are not always included."""
        return tuple(g for g in self.variances if not self.pool.groups[g].always_included)

    @cached_property
    def objective(self) -> float:
        """Objective L: the log marginal likelihood (`evidence`) minus the price of every selected group, nats."""
        shared = float((self.of_kind - 1).clip(0) @ self.pool.shared)
        return self.pool.constant + self.evidence - self.paid + shared

    @property
    def paid(self) -> float:
        """Sum of the prices of the selected groups without discounts for several groups of one kind, nats."""
        return sum(float(self.pool.price[g]) + self._further_sites(g) for g in self.found)

    @property
    def utility(self) -> float:
        """The objective minus the price (`Price.to_read`) of curves and formulas that are hard to read, nats."""
        return self.objective - self.pool.reading_held - float(sum(self.pool.reading[g] for g in self.found))

    def net_gain(self, g: int) -> float:
        """Return the gain of a group in the model minus its price, nats."""
        return self.gains[g][0] - self.price(g)

    @cached_property
    def of_kind(self) -> IntArray:
        """Number of selected parts (K,) of each joint group."""
        kinds = self.pool.block[list(self.found)]
        return self.pool.kinds_held + np.bincount(kinds[kinds >= 0], minlength=len(self.pool.shared))

    @cached_property
    def prices(self) -> Array:
        """Price (G,) of each group given the others, nats: the price of its site if its kind is in the model."""
        others = np.append(self.of_kind, 0)[self.pool.block]
        others[list(self.found)] -= 1
        return self.pool.price - np.where(others > 0, np.append(self.pool.shared, 0.0)[self.pool.block], 0.0)

    def price(self, g: int) -> float:
        """Return the price of a group given the others, nats: if its kind is in the model, ln n for its n sites."""
        return float(self.prices[g]) + self._further_sites(g)

    def _further_sites(self, g: int) -> float:
        if not self.pool.groups[g].parts:
            return 0.0
        return max(len(np.unique(self.part_of_column(g))) - 1, 0) * self.price_of_site(g)

    def price_of_site(self, g: int) -> float:
        """Return the price ln n, nats, of the site of a group that may act at n sites."""
        return math.log(max(len(self.pool.groups[g].parts), 1))

    def part_of_column(self, g: int) -> IntArray:
        """Return the part to which each remaining column of a joint group belongs, by index; empty for other groups."""
        sizes = [len(part.effects) for part in self.pool.groups[g].parts]
        return np.repeat(np.arange(len(sizes)), sizes)[self.chosen[g]] if sizes else np.zeros(0, dtype=np.int64)
