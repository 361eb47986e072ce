"""Which parameters the poses can tell apart: scaling, rank, unique shares."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray

NEGLIGIBLE = 1e-7
LIMITS = (20.0, 50.0, 200.0, 1000.0, 1e4, 1e6)


def orthonormal(columns: Array) -> Array:
    """Orthonormal basis (M, k) of the span of columns (M, K), scaled before the rank is decided."""
    norms = np.linalg.norm(columns, axis=0)
    scaled = columns[:, norms > NEGLIGIBLE] / norms[norms > NEGLIGIBLE]
    if scaled.shape[1] == 0:
        return np.zeros((len(columns), 0))
    u, s, _ = linalg.svd(scaled, full_matrices=False)
    return u[:, s > 1e-9 * s[0]]


def remove(basis: Array, columns: Array) -> Array:
    """Columns (M, K) less their part in the span of an orthonormal basis (M, k)."""
    return columns - basis @ (basis.T @ columns)


def unique_shares(columns: Array) -> Array:
    """Share (K,) of each column's norm that no other column explains: 1 / sqrt(diag((CᵀC)⁻¹)) of unit columns."""
    norms = np.linalg.norm(columns, axis=0)
    safe = np.where(norms > NEGLIGIBLE, norms, 1.0)
    _, r = linalg.qr(columns / safe, mode="economic")
    try:
        inverse = linalg.solve_triangular(r, np.eye(r.shape[1]))
    except linalg.LinAlgError:
        return np.zeros(columns.shape[1])
    shares = 1.0 / np.linalg.norm(inverse, axis=1)
    return np.where(norms > NEGLIGIBLE, np.minimum(shares, 1.0), 0.0)


@dataclass(frozen=True)
class Ranking:
    """Candidate columns in the order in which each adds most, and what each then adds.

    order: (k,) indices of candidates worth an order (near-zero ones are left out). share: (k,) part of each
    scaled column that the fixed columns and those before it in the order do not explain.
    """

    order: IntArray
    share: Array

    def kept(self, condition_limit: float) -> IntArray:
        """Candidates whose share is at least 1 / limit, in their original order."""
        return np.sort(self.order[self.share >= 1.0 / condition_limit])


def rank(fixed: Array, candidates: Array) -> Ranking:
    """Pivoted QR of the scaled candidates (M, C) after removing the fixed columns (M, F).

    Near-zero columns are dropped before scaling. Source: Golub and Van Loan, 5.4.2.
    """
    norms = np.linalg.norm(candidates, axis=0)
    alive = np.flatnonzero(norms > NEGLIGIBLE * np.sqrt(len(candidates)))
    if len(alive) == 0:
        return Ranking(np.zeros(0, dtype=np.int64), np.zeros(0))
    scaled = remove(orthonormal(fixed), candidates[:, alive] / norms[alive])
    r, pivots = linalg.qr(scaled, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(r))
    return Ranking(alive[pivots[: len(diagonal)]], diagonal)


@dataclass(frozen=True)
class RankChoice:
    """One point of the curve of cross-validated error against rank."""

    condition_limit: float
    rank: int
    cv_rms: float


def cross_validate(columns: Array, target: Array, fold_of_row: IntArray) -> float:
    """RMS of target (M,) predicted by least squares from the folds each row is not in."""
    scale = np.linalg.norm(columns, axis=0)
    scaled = columns / np.where(scale > 0, scale, 1.0)
    total = 0.0
    for fold in np.unique(fold_of_row):
        test = fold_of_row == fold
        solution = linalg.lstsq(scaled[~test], target[~test], cond=1e-12, lapack_driver="gelsy")[0]
        total += float(np.sum((target[test] - scaled[test] @ solution) ** 2))
    return float(np.sqrt(total / len(target)))


def rank_curve(
    fixed: Array, candidates: Array, ranking: Ranking, target: Array, fold_of_row: IntArray
) -> tuple[RankChoice, ...]:
    """Cross-validated error at each of LIMITS; limits that keep the same columns share one point."""
    curve: dict[int, RankChoice] = {}
    for limit in LIMITS:
        kept = ranking.kept(limit)
        if len(kept) not in curve:
            columns = np.hstack([fixed, candidates[:, kept]])
            error = cross_validate(columns, target, fold_of_row)
            curve[len(kept)] = RankChoice(limit, fixed.shape[1] + len(kept), error)
    return tuple(curve.values())


def canonical_correlation(first: Array, second: Array) -> float:
    """Smallest correlation between the smaller span and the larger, of orthonormal columns (M, a) and (M, b)."""
    inside = second.T @ first
    return float(np.linalg.svd(inside, compute_uv=False).min()) if inside.size else 0.0
