"""Compute the posterior of the groups of effects in a model, its log evidence, and the gain of each group.

A holds the K columns of the selected groups, each times √a (prior standard deviation). C = σ² I + A Aᵀ is the marginal
covariance of the target y. With H = (σ² I + AᵀA)⁻¹ = L⁻ᵀL⁻¹, C⁻¹ = (I - A H Aᵀ) / σ²; a group X needs only XᵀA and Xᵀy.
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
"""Least noise of one coordinate, m: a tenth of an instrument's resolution. In exact data smaller noise is rounding."""
LEAST = 10.0**-DECADES
"""Least ratio of the prior variance of a group to its largest allowed variance. A group that explains nothing reaches
the least prior variance, and is deleted."""


@dataclass(frozen=True)
class Active:
    """A linear model: groups of effects by number, with prior variances. chosen: effects of each group in the model."""

    pool: GroupPool
    variances: dict[int, float]
    chosen: dict[int, IntArray]
    sigma2: float

    @property
    def criteria(self) -> Criteria:
        """Limits for adding and deleting groups, see `Criteria`."""
        return self.pool.prices.limits

    def added(self, g: int, variance: float, part: Sequence[int] | None = None) -> "Active":
        """Add group g to the model. variance: prior variance of g. part: effects of g to add; None for all."""
        effects = np.arange(len(self.pool.index[g]))[slice(None) if part is None else part]
        return replace(self, variances={**self.variances, g: variance}, chosen={**self.chosen, g: effects})

    def beside(self, group: Group, variance: float) -> "Active":
        """Return the model with a new group, the only candidate, added at the prior variance `variance`."""
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
        """Sets of candidate groups formed for this model, by the groups whose prior variance is fixed."""
        return {}

    @cached_property
    def blocks(self) -> dict[int, slice]:
        """Range of columns that belong to each group of the model."""
        out, at = {}, 0
        for g in self.variances:
            out[g] = slice(at, at + len(self.chosen[g]))
            at = out[g].stop
        return out

    @cached_property
    def index(self) -> IntArray:
        """Index, among the distinct effects, of the effect of each of the K columns of the model."""
        return np.concatenate([self.pool.index[g][self.chosen[g]] for g in self.variances])

    @cached_property
    def scale(self) -> Array:
        """Prior standard deviation of the coefficient of each column: √a spread, with a the group's prior variance."""
        roots = [np.sqrt(a) * self.pool.spreads[g][self.chosen[g]] for g, a in self.variances.items()]
        return np.concatenate(roots)

    @cached_property
    def inner(self) -> Array:
        """Inner products AᵀA of the columns of the model, each scaled by its prior standard deviation."""
        root = np.sqrt(np.repeat(list(self.variances.values()), [len(c) for c in self.chosen.values()]))
        return np.asarray(root[:, None] * self.pool.gram(self.chosen) * root)

    @cached_property
    def rhs(self) -> Array:
        """Inner products Aᵀy of the columns of the model with the target y, scaled by prior standard deviations."""
        return self.scale * self.pool.rhs[self.index]

    @cached_property
    def lower(self) -> Array:
        """Lower Cholesky factor of σ² I + AᵀA, with the rounding error of the products added to the diagonal."""
        count = len(self.rhs)
        rounding = count * np.finfo(float).eps * float(np.max(np.diag(self.inner), initial=0.0))
        regular = np.array(self.inner, order="F")
        np.fill_diagonal(regular, np.diag(regular) + self.sigma2 + rounding)
        return np.asarray(linalg.cholesky(regular, lower=True, overwrite_a=True, check_finite=False))

    @cached_property
    def inverse(self) -> Array:
        """Inverse of the lower Cholesky factor of σ² I + AᵀA, with A the scaled columns of the model."""
        return np.asarray(linalg.lapack.dtrtri(self.lower, lower=1)[0])

    @cached_property
    def spanned(self) -> Array:
        """Basis B of the scaled columns of the model; B Bᵀ is the ridge projection of rows onto the columns."""
        columns = [np.sqrt(a) * self.pool.columns(g)[:, self.chosen[g]] for g, a in self.variances.items()]
        return np.hstack(columns) @ self.inverse.T

    @cached_property
    def mean(self) -> Array:
        """Posterior mean of the coefficients, each in units of its prior standard deviation `scale`."""
        return self.inverse.T @ (self.inverse @ self.rhs)

    @cached_property
    def left(self) -> Array:
        """Residual of the model, whitened, one value per measured row."""
        left = self.pool.rows.target.copy()
        for g, at in self.blocks.items():
            left -= self.pool.columns(g)[:, self.chosen[g]] @ (np.sqrt(self.variances[g]) * self.mean[at])
        return left

    @property
    def energy(self) -> float:
        """Sum of squares of the residual y - Aμ of target y, columns A, posterior mean μ: |y|² - yᵀAμ - σ² |μ|²."""
        taken = self.mean @ (self.rhs + self.sigma2 * self.mean) if self.variances else 0.0
        return float(self.pool.square - taken)

    @cached_property
    def misfit(self) -> Array:
        """Sum of squares of each pose's whitened residual, in units of the noise variance σ²."""
        return np.bincount(self.pool.rows.pose_of_row, self.left**2) / self.sigma2

    @property
    def unknowns(self) -> float:
        """Effective number of coefficients that the data determine rather than the prior (γ of MacKay)."""
        return len(self.mean) - self.sigma2 * float(np.sum(self.inverse**2))

    @cached_property
    def mismatch(self) -> float:
        """Sum of squares yᵀC⁻¹y of the target y, weighted by the inverse of its marginal covariance C."""
        return (self.pool.square - float(np.sum((self.inverse @ self.rhs) ** 2))) / self.sigma2

    @cached_property
    def evidence(self) -> float:
        """Log marginal likelihood, nats, of the measurements after registration and tool are projected out."""
        freedom, count = self.pool.rows.freedom, len(self.rhs)
        volume = (freedom - count) * float(np.log(self.sigma2)) + 2.0 * float(np.sum(np.log(np.diag(self.lower))))
        return -0.5 * (volume + self.mismatch + freedom * float(np.log(2 * np.pi)))

    def own(self, g: int, part: IntArray | slice = slice(None)) -> tuple[Array, Array]:
        """Return eigenvalues of XᵀC⁻¹X and projections of XᵀC⁻¹y for a group's columns X; C: covariance of y."""
        at = np.arange(self.blocks[g].start, self.blocks[g].stop)[part]
        return self._taken_out(at[None], np.array([self.variances[g]]))

    def _taken_out(self, at: IntArray, a: Array) -> tuple[Array, Array]:
        """Return eigenvalues s of XᵀC⁻¹X = V s Vᵀ, and q = VᵀXᵀC⁻¹y. X: columns of each group; C: covariance of y.

        σ²H_gg = V h Vᵀ: posterior over prior covariance; μ: posterior mean; a s = (1 - h) / h, √a q = Vᵀμ / h.
        """
        halves = (self.inverse[own[0] :, own] for own in at)
        h, turn = np.linalg.eigh(self.sigma2 * np.array([half.T @ half for half in halves]))
        h = np.clip(h, 1e-15, 1.0)
        turned = np.matmul(self.mean[at][:, None, :], turn)[:, 0]
        return (1.0 - h) / h / a[:, None], turned / h / np.sqrt(a)[:, None]

    @cached_property
    def gains(self) -> dict[int, tuple[float, float]]:
        """Gain in log evidence, nats, by each group in the model, and the group's best prior variance."""
        return self._gains(np.arange(len(self.variances)))

    def _gains(self, of: IntArray) -> dict[int, tuple[float, float]]:
        """Return log evidence gain, nats, and best prior variance of some groups of the model, at positions `of`.

        Groups of few columns are padded with columns of zeros, which gain nothing.
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
        """First column of each group of the model, and number of columns of each group."""
        first = np.array([own.start for own in self.blocks.values()], dtype=np.int64)
        return first, np.diff(first, append=len(self.rhs))

    @cached_property
    def reestimated(self) -> dict[int, float]:
        """Re-estimated prior variance a of each group: the best one for one or two columns, else MacKay's a |μ|² / γ.

        μ: posterior mean of the group's coefficients in units of √a. γ: effective number of coefficients that the data
        determine (MacKay). The update of variances needs no eigenvalues, and is stationary at the largest evidence.
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
        """Objective L: the log marginal likelihood (`evidence`) minus the penalty of every selected group, nats."""
        shared = float((self.of_kind - 1).clip(0) @ self.pool.shared)
        return self.pool.constant + self.evidence - self.paid + shared

    @property
    def paid(self) -> float:
        """Sum of the penalties of the selected groups, nats, without the discount for several groups of one kind."""
        return sum(float(self.pool.price[g]) + self._further_sites(g) for g in self.found)

    @property
    def utility(self) -> float:
        """Objective L minus the extra penalties (`Price.to_read`) of groups that are hard to read, nats."""
        return self.objective - self.pool.reading_held - float(sum(self.pool.reading[g] for g in self.found))

    def net_gain(self, g: int) -> float:
        """Return the log evidence gain of a group in the model minus the group's penalty, nats."""
        return self.gains[g][0] - self.price(g)

    @cached_property
    def of_kind(self) -> IntArray:
        """Number of selected parts of each joint group (effects of one kind at several sites)."""
        kinds = self.pool.block[list(self.found)]
        return self.pool.kinds_held + np.bincount(kinds[kinds >= 0], minlength=len(self.pool.shared))

    @cached_property
    def prices(self) -> Array:
        """Penalty of each group given the others, nats; only that of its site if its kind is already in the model."""
        others = np.append(self.of_kind, 0)[self.pool.block]
        others[list(self.found)] -= 1
        return self.pool.price - np.where(others > 0, np.append(self.pool.shared, 0.0)[self.pool.block], 0.0)

    def price(self, g: int) -> float:
        """Return the penalty of a group given the others, nats, plus ln n for each further of its n possible sites."""
        return float(self.prices[g]) + self._further_sites(g)

    def _further_sites(self, g: int) -> float:
        if not self.pool.groups[g].parts:
            return 0.0
        return max(len(np.unique(self.part_of_column(g))) - 1, 0) * self.price_of_site(g)

    def price_of_site(self, g: int) -> float:
        """Return the penalty ln n, nats, of one site of a group that may act at n sites."""
        return math.log(max(len(self.pool.groups[g].parts), 1))

    def part_of_column(self, g: int) -> IntArray:
        """Return the number of the site of each column of a joint group; empty for a group of one site."""
        sizes = [len(part.effects) for part in self.pool.groups[g].parts]
        return np.repeat(np.arange(len(sizes)), sizes)[self.chosen[g]] if sizes else np.zeros(0, dtype=np.int64)
