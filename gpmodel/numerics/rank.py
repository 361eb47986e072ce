"""Select the parameters that a set of poses can identify: scaling, rank, unique shares."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, Count, IntArray, Mask, NotNegative

NEGLIGIBLE = 1e-7
"""Relative norm below which a column is rounding error: a few times the square root of double precision."""
LIMITS = (1.0, 20.0, 50.0, 200.0, 1000.0, 1e4, 1e6)
"""Condition limits among which cross-validation chooses. Between two neighbouring limits the number of an arm's fitted
constants changes."""


def orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis of the span of columns, which are first scaled to unit norm."""
    norms = np.linalg.norm(columns, axis=0)
    scaled = columns[:, norms > NEGLIGIBLE] / norms[norms > NEGLIGIBLE]
    if scaled.shape[1] == 0:
        return np.zeros((len(columns), 0))
    u, s, _ = linalg.svd(scaled, full_matrices=False)
    return np.asarray(u[:, s > 1e-9 * s[0]])


def remove(basis: Array, columns: Array) -> Array:
    """Project an orthonormal basis out of columns."""
    return columns - basis @ (basis.T @ columns)


def square_root(matrix: Array) -> Array:
    """Return F with F Fᵀ = `matrix`, symmetric and positive semidefinite up to rounding errors."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def factored(gram: Array) -> tuple[Array, bool]:
    """Return the Cholesky factor of the normal matrix of unit columns, for scipy's cho_solve.

    The input matrix `gram` is overwritten. The matrix is passed transposed, since LAPACK stores matrices by column.
    """
    gram[np.diag_indices_from(gram)] += 1e-12
    factor: tuple[Array, bool] = linalg.cho_factor(gram.T, overwrite_a=True, check_finite=False)
    return factor


@dataclass(frozen=True)
class Span:
    """Span of columns, some of which have priors.

    plain: orthonormal basis of the columns without priors.
    rest: columns with priors, orthogonal to the plain columns.
    factor: Cholesky factor of the inner products of `rest`, for scipy's cho_solve.
    """

    plain: Array
    rest: Array | None = None
    factor: tuple[Array, bool] | None = None

    @classmethod
    def of(cls, columns: Array, with_prior: Mask, gram: Array) -> "Span":
        """Build the span of columns of unit length.

        The rank of the columns without priors is decided by SVD; columns with priors are all kept and factored by
        Cholesky.
        with_prior: True for columns with a prior, which is a further row of the column.
        gram: products of all columns, needed if a column has a prior.
        """
        plain = orthonormal(columns[:, ~with_prior])
        if not with_prior.any():
            return cls(plain)
        inside = plain.T @ columns[:, with_prior]
        factor = factored(gram[np.ix_(with_prior, with_prior)] - inside.T @ inside)
        rest = columns[:, with_prior]
        rest -= plain @ inside
        return cls(plain, rest, factor)

    def weighed(self, rows: slice, weight: float) -> "Span":
        """Return the span with rows of priors multiplied by `weight`; columns without priors are zero in these rows."""
        rest = np.array(self.rest)
        rest[rows] *= weight
        return Span(self.plain, rest, factored(rest.T @ rest))

    @property
    def size(self) -> int:
        """Number of columns, with or without priors, that span the space."""
        return int(self.plain.shape[1] + (0 if self.rest is None else self.rest.shape[1]))

    def remove(self, columns: Array) -> Array:
        """Return columns minus their projection on the span."""
        left = remove(self.plain, columns)
        if self.rest is not None:
            left -= self.rest @ linalg.cho_solve(self.factor, self.rest.T @ left, check_finite=False)
        return left

    @cached_property
    def basis(self) -> Array:
        """Orthonormal basis of the span of all columns."""
        if self.rest is None:
            return self.plain
        upper = self.factor[0] if self.factor else np.zeros((0, 0))
        turned = linalg.solve_triangular(upper, self.rest.T, trans="T", check_finite=False).T
        return np.hstack([self.plain, turned])


def unique_shares(columns: Array) -> Array:
    """Return the share of each column's norm that no other column explains.

    The share is 1 / sqrt(diag((CᵀC)⁻¹)) of unit columns C, and 0 of a zero column.
    """
    norms, shares = np.linalg.norm(columns, axis=0), np.zeros(columns.shape[1])
    seen = norms > NEGLIGIBLE
    _, r = linalg.qr(columns[:, seen] / norms[seen], mode="economic")
    try:
        inverse = linalg.solve_triangular(r, np.eye(r.shape[1]))
    except linalg.LinAlgError:
        return shares
    shares[seen] = np.minimum(1.0 / np.linalg.norm(inverse, axis=1), 1.0)
    return shares


@dataclass(frozen=True)
class Ranking:
    """Candidate columns in order of preference, from which a well-conditioned subset is selected.

    fixed: orthonormal columns that are always included.
    candidates: candidate columns of unit length.
    order: indices of the candidates, the preferred first; candidates near zero are left out.
    """

    fixed: Array
    candidates: Array
    order: IntArray

    def kept(self, condition_limit: float) -> IntArray:
        """Select a well-conditioned subset of candidate columns in order of preference; return their sorted indices.

        A candidate is kept if at least 1 / condition_limit of its unit length is orthogonal to the fixed and the kept
        columns. The order of several dependent columns, not the poses, thereby decides which column is kept.
        """
        basis, kept = self.fixed, []
        for k in self.order:
            left = remove(basis, remove(basis, self.candidates[:, [k]]))
            share = float(np.linalg.norm(left))
            if share >= 1.0 / condition_limit:
                basis = np.hstack([basis, left / share])
                kept.append(k)
        return np.sort(np.array(kept, dtype=np.int64))


def rank(fixed: Array, candidates: Array, order: IntArray | None = None) -> Ranking:
    """Order candidate columns, given fixed columns, by preference.

    order: indices of the candidates, the preferred first; by default in the order of the columns.
    Columns near zero are dropped before scaling. QR reduces the number of rows to the number of columns and keeps all
    inner products. Source: Golub and Van Loan, 5.2.
    """
    norms = np.linalg.norm(candidates, axis=0)
    alive = norms > NEGLIGIBLE * np.sqrt(len(candidates))
    scaled = candidates / np.where(alive, norms, 1.0)
    both = triangle(np.hstack([fixed, scaled]))
    order = np.arange(len(norms)) if order is None else order
    return Ranking(orthonormal(both[:, : fixed.shape[1]]), both[:, fixed.shape[1] :], order[alive[order]])


@dataclass(frozen=True)
class RankChoice:
    """Cross-validated error at one condition limit. spread: standard error of the error cv_rms over the folds."""

    condition_limit: NotNegative
    rank: Count
    cv_rms: NotNegative
    spread: NotNegative = 0.0


@dataclass(frozen=True)
class Folded:
    """Columns and a target, reduced by QR to one triangle per fold, for cross-validation of any subset of columns.

    triangles: triangular factor R of each fold, with RᵀR the inner products of columns and target over the rows of the
    fold.
    rows: number of rows of each fold.
    """

    triangles: tuple[Array, ...]
    rows: IntArray

    def squared(self, chosen: IntArray) -> Array:
        """Return the sum of squared prediction errors of each fold, with coefficients fitted to the other folds.

        chosen: indices of the fitted columns.
        """
        out = []
        for k, tested in enumerate(self.triangles):
            others = np.vstack([r for j, r in enumerate(self.triangles) if j != k])
            norms = np.linalg.norm(others[:, chosen], axis=0)
            scale = np.where(norms > 0, norms, 1.0)
            found = linalg.lstsq(others[:, chosen] / scale, others[:, -1], cond=1e-12, lapack_driver="gelsy")[0]
            out.append(float(np.sum((tested[:, -1] - tested[:, chosen] @ (found / scale)) ** 2)))
        return np.array(out)


def folded(columns: Array, target: Array, fold_of_row: IntArray) -> Folded:
    """Prepare columns and target for cross-validation. fold_of_row: fold of each row."""
    both = np.column_stack([columns, target])
    rows = np.unique(fold_of_row, return_counts=True)
    triangles = (triangle(both[fold_of_row == fold]) for fold in rows[0])
    return Folded(tuple(triangles), rows[1])


def triangle(columns: Array) -> Array:
    """Return the triangular factor R of the QR decomposition of columns; RᵀR are their inner products."""
    return np.asarray(linalg.qr(columns, mode="r", check_finite=False)[0])[: columns.shape[1]]


def rank_curve(ranking: Ranking, data: Folded, fixed: int) -> tuple[RankChoice, ...]:
    """Return the cross-validated error at each condition limit; limits that keep equal columns share one point.

    data: the fixed columns, followed by the candidates, and the target.
    fixed: number of fixed columns.
    """
    curve: dict[tuple[int, ...], RankChoice] = {}
    for limit in LIMITS:
        kept = ranking.kept(limit)
        if tuple(kept) not in curve:
            squared = data.squared(np.concatenate([np.arange(fixed), fixed + kept]))
            error = float(np.sqrt(squared.sum() / data.rows.sum()))
            each = np.sqrt(squared / data.rows)
            spread = float(np.std(each, ddof=1) / np.sqrt(len(each))) if len(each) > 1 else 0.0
            curve[tuple(kept)] = RankChoice(limit, fixed + len(kept), error, spread)
    return tuple(curve.values())
