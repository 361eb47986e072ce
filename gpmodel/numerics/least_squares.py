"""Least squares of unit columns, few by pivoted QR, many by normal equations; without a column, or without rows."""

import ctypes
import sys
from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.spatial import cKDTree

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.numerics.rank import NEGLIGIBLE, factored


def give_back() -> None:
    """Give it to the system, where the C library can: glibc keeps what arrays of up to 32 MB had, hundreds of megabytes
    after a search, beside which larger ones are allocated anew."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim:
        trim(0)


OUTLIER_SIGMAS = 6.0
"""Robust standard deviations beyond which an error is an outlier: one in 10⁵ lengths of 3-D normal errors."""

OUTLIER_SHARE = 0.15
"""Largest share of poses that a fit leaves out. More of them are another model."""

SMALLEST_SPREAD = 1e-9
"""Smallest spread of errors, m: exact tables have no outliers."""


NEIGHBOURS = 5
"""Nearest poses that are compared with an outlier. If every fiftieth pose is one at random, three of five are with a
probability of 1e-4."""

ALIKE = 0.5
"""Least cosine between errors of one direction: a quarter of all directions."""

MAD_SIGMAS = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""


def outlier_limit(errors: Array, sigmas: float = OUTLIER_SIGMAS) -> float:
    """Length beyond which one of the errors (N,) is an outlier: median + sigmas · 1.4826 · MAD."""
    middle = float(np.median(errors))
    return middle + sigmas * max(MAD_SIGMAS * float(np.median(np.abs(errors - middle))), SMALLEST_SPREAD)


def among_worst(errors: Array, spared: int = 0) -> Mask:
    """The largest of the errors (N,): OUTLIER_SHARE of them, one at least, less those spared already."""
    most = max(1, int(OUTLIER_SHARE * len(errors))) - spared
    return np.isin(np.arange(len(errors)), np.argsort(errors)[::-1][:most])


def in_company(far: Mask, places: Array, errors: Array) -> Mask:
    """Outliers (N,) of which most of the nearest NEIGHBOURS are outliers in the same direction: there the model is
    wrong, not the measurement, and leaving them out would hide it.

    places: (N, n), compared over their ranges. errors: (N, m), NaN where nothing was measured.
    """
    company = np.zeros(len(far), dtype=bool)
    span = np.ptp(places, axis=0)
    if not far.any() or len(far) <= 2 * NEIGHBOURS or not (span > 0).any():
        return company
    scaled = places[:, span > 0] / span[span > 0]
    beside = cKDTree(scaled).query(scaled[far], NEIGHBOURS + 1)[1][:, 1:]
    known = np.nan_to_num(errors)
    unit = known / np.maximum(np.linalg.norm(known, axis=1), SMALLEST_SPREAD)[:, None]
    alike = np.einsum("fm,fkm->fk", unit[far], unit[beside]) > ALIKE
    company[far] = 2 * (alike & far[beside]).sum(axis=1) > NEIGHBOURS
    return company


MANY_COLUMNS = 100
"""Columns from which normal equations replace pivoted QR. So many come with priors, which keep the equations
regular."""


def solve(system: Array, target: Array) -> Array:
    """x (K,) or (K, R) that minimises |A x - b|² for unit columns A (M, K): by pivoted QR, or by normal equations where
    hundreds of priors keep them regular."""
    if system.shape[1] < MANY_COLUMNS:
        return np.asarray(linalg.lstsq(system, target, cond=1e-10, lapack_driver="gelsy", check_finite=False)[0])
    return np.asarray(linalg.cho_solve(factored(system.T @ system), system.T @ target, check_finite=False))


def inverse_gram(columns: Array) -> Array:
    """(CᵀC)⁻¹ (K, K) of unit columns: a pseudo-inverse by QR."""
    root = np.linalg.pinv(np.linalg.qr(columns, mode="r"), rcond=1e-9)
    return root @ root.T


def inverse_of(products: Array) -> Array:
    """The inverse (K, K) of products of unit columns that priors keep regular, by Cholesky; it overwrites them."""
    return np.asarray(linalg.cho_solve(factored(products), np.eye(len(products)), check_finite=False))


def root_mean_square(values: Array) -> float:
    """√ mean v² of values (N,); NaN of none."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


REGULAR = 1e-13
"""Least eigenvalue of the products of unit columns over the largest. Smaller ones are rounding."""

INSIDE = 1e-6
"""Share of a unit vector of coefficients in the null space of the columns. Above it the column lies in the span of the
others."""


@dataclass(frozen=True)
class LeaveOneOut:
    """Columns (M, K) as U s Vᵀ times their norms (K,), singular values that are rounding left out.

    The part of column k that no other explains lies along row k of the pseudo-inverse. Source: Golub and Van Loan, 5.5.
    """

    norms: Array
    u: Array
    s: Array
    v: Array

    @classmethod
    def of(cls, columns: Array) -> "LeaveOneOut":
        """Build from columns (M, K), scaled before the rank is decided; negligible columns count as zero.

        With hundreds of columns that priors keep regular, uses the eigenvalues s² of their products.
        """
        norms = np.sqrt(np.einsum("mk,mk->k", columns, columns))
        norms = np.where(norms > NEGLIGIBLE, norms, np.inf)
        if columns.shape[1] >= MANY_COLUMNS:
            square, v = linalg.eigh(columns.T @ columns / np.outer(norms, norms), check_finite=False)
            kept = square > REGULAR * square[-1]
            s, v = np.sqrt(square[kept]), v[:, kept]
            return cls(norms, columns @ (v / s / norms[:, None]), s, v)
        u, s, vt = linalg.svd(columns / norms, full_matrices=False, check_finite=False)
        rank = int(np.sum(s > 1e-9 * s[0]))
        return cls(norms, u[:, :rank], s[:rank], vt[:rank].T)

    def alone(self, k: int) -> Array:
        """Return the part (M,) of column k that the other columns do not span; zero if they span it."""
        own = self.v[k]
        if own @ own < 1.0 - INSIDE:
            return np.zeros(len(self.u))
        along = self.u @ (own / self.s)
        return np.asarray(along * self.norms[k] / (along @ along))

    def by_others(self, k: int, values: Array) -> Array:
        """Coefficients (K, R), zero for column k, with which the others come nearest to values (M, R)."""
        solved = self.v @ ((self.u.T @ values) / self.s[:, None])
        spread = self.v @ (self.v[k] / self.s**2)
        return np.asarray((solved - np.outer(spread / spread[k], solved[k])) / self.norms[:, None])


@dataclass(frozen=True)
class Omitted:
    """Rows (T,) left out of columns with the orthonormal basis B (M, K), W (T, K) that of these rows.

    What the columns fitted to the other rows miss them by is A⁻¹ times what those fitted to all rows leave there, A = I
    - W Wᵀ. Where there are fewer columns than rows, A⁻¹ = I + W (I - WᵀW)⁻¹ Wᵀ. factor: of the smaller one, for scipy's
    cho_solve. Source: Cook and Weisberg (1982), 2.2.
    """

    rows: IntArray
    there: Array
    factor: tuple[Array, bool]

    @classmethod
    def of(cls, rows: IntArray, basis: Array) -> "Omitted":
        """Some rows of an orthonormal basis (M, K)."""
        there = basis[rows]
        square = there @ there.T if len(rows) <= basis.shape[1] else there.T @ there
        return cls(rows, there, factored(np.eye(len(square)) - square))

    def freed(self, values: Array) -> Array:
        """A⁻¹ times values (T, R)."""
        if len(self.rows) <= self.there.shape[1]:
            return np.asarray(linalg.cho_solve(self.factor, values, check_finite=False))
        inside = linalg.cho_solve(self.factor, self.there.T @ values, check_finite=False)
        return np.asarray(values + self.there @ inside)
