"""Least squares on unit columns: pivoted QR for few columns, normal equations for many; omission of columns or rows."""

import ctypes
import sys
from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.spatial import cKDTree

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.numerics.rank import NEGLIGIBLE, factored


def give_back() -> None:
    """Return freed memory to the operating system, on Linux.

    The C library glibc keeps freed arrays of up to 32 MB, hundreds of megabytes after a search.
    """
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim:
        trim(0)


OUTLIER_SIGMAS = 6.0
"""Robust standard deviations from the median beyond which a position error is an outlier: one in 10⁵ lengths of 3-D
normal errors."""

OUTLIER_SHARE = 0.15
"""Largest share of poses that a fit excludes as outliers. If more poses deviate from a model, the model is wrong."""

SMALLEST_SPREAD = 1e-9
"""Smallest spread of errors, m, for the outlier limit. Tables without noise have no outliers."""


NEIGHBOURS = 5
"""Number of nearest poses that are compared with an outlier. If every fiftieth pose is an outlier at random, three of
five neighbours are outliers with a probability of 1e-4."""

ALIKE = 0.5
"""Least cosine of two error vectors that count as of one direction; a quarter of random pairs have a larger cosine."""

MAD_SIGMAS = 1.4826
"""Ratio of the standard deviation of a normal distribution to its median absolute deviation."""


def outlier_limit(errors: Array, sigmas: float = OUTLIER_SIGMAS) -> float:
    """Return the length beyond which an error is an outlier: median + sigmas · 1.4826 · MAD of all errors."""
    middle = float(np.median(errors))
    return middle + sigmas * max(MAD_SIGMAS * float(np.median(np.abs(errors - middle))), SMALLEST_SPREAD)


def among_worst(errors: Array, use: Mask | None = None) -> Mask:
    """Mark the largest errors that may still be excluded as outliers, as a mask of poses.

    At most the share OUTLIER_SHARE of all poses, and at least one pose, is excluded in total.
    use: poses that are not excluded yet; None for all poses.
    """
    use = np.ones(len(errors), dtype=bool) if use is None else use
    most = max(1, int(OUTLIER_SHARE * len(errors))) - int((~use).sum())
    worst = np.argsort(np.where(use, errors, -np.inf))[::-1]
    return np.isin(np.arange(len(errors)), worst[: max(most, 0)])


def in_company(far: Mask, places: Array, errors: Array) -> Mask:
    """Mark outliers whose nearest neighbours are mostly outliers with errors in nearly one direction.

    A wrong model causes a region of outliers; excluding the poses of the region would hide the model's error.
    far: mask of the outliers.
    places: joint values or positions of the poses, each column compared relative to its range.
    errors: error vectors of the poses, m, NaN where nothing was measured.
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
"""Number of columns from which normal equations replace pivoted QR. Many columns have priors, which keep the normal
equations regular."""


def solve(system: Array, target: Array) -> Array:
    """Return x that minimises |A x - b|² for unit columns A = `system` and b = `target`.

    Fewer than MANY_COLUMNS columns are solved by pivoted QR, more columns by normal equations, which priors keep
    regular.
    """
    if system.shape[1] < MANY_COLUMNS:
        return np.asarray(linalg.lstsq(system, target, cond=1e-10, lapack_driver="gelsy", check_finite=False)[0])
    return np.asarray(linalg.cho_solve(factored(system.T @ system), system.T @ target, check_finite=False))


def inverse_gram(columns: Array) -> Array:
    """Return (CᵀC)⁻¹ of unit columns C, a pseudo-inverse by QR."""
    root = np.linalg.pinv(np.linalg.qr(columns, mode="r"), rcond=1e-9)
    return root @ root.T


def inverse_of(products: Array) -> Array:
    """Return the inverse of a matrix CᵀC that priors keep regular, by Cholesky; `products` is overwritten."""
    return np.asarray(linalg.cho_solve(factored(products), np.eye(len(products)), check_finite=False))


def root_mean_square(values: Array) -> float:
    """Return √ mean v² of values v, NaN if there are no values."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


REGULAR = 1e-13
"""Least eigenvalue of the normal matrix of unit columns, relative to the largest. Smaller eigenvalues are rounding
errors."""

INSIDE = 1e-6
"""Largest share of a unit vector of coefficients in the null space of the columns. With a larger share a column lies
in the span of the other columns."""


@dataclass(frozen=True)
class LeaveOneOut:
    """Singular value decomposition of columns, for fits of any one column by the other columns.

    The columns are U s Vᵀ times their norms; singular values at the level of rounding are left out. The part of
    column k orthogonal to the other columns lies along row k of the pseudo-inverse. Source: Golub and Van Loan, 5.5.
    """

    norms: Array
    u: Array
    s: Array
    v: Array

    @classmethod
    def of(cls, columns: Array) -> "LeaveOneOut":
        """Decompose columns, scaled to unit norm before the rank is decided; negligible columns count as zero.

        For MANY_COLUMNS and more, s² are the eigenvalues of the normal matrix, which priors keep regular.
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
        """Return the part of column k that is orthogonal to the other columns, zero if column k is in their span."""
        own = self.v[k]
        if own @ own < 1.0 - INSIDE:
            return np.zeros(len(self.u))
        along = self.u @ (own / self.s)
        return np.asarray(along * self.norms[k] / (along @ along))

    def by_others(self, k: int, values: Array) -> Array:
        """Return coefficients of the least-squares fit of values by all columns except column k.

        The coefficient of column k is zero.
        """
        solved = self.v @ ((self.u.T @ values) / self.s[:, None])
        spread = self.v @ (self.v[k] / self.s**2)
        return np.asarray((solved - np.outer(spread / spread[k], solved[k])) / self.norms[:, None])


@dataclass(frozen=True)
class Omitted:
    """Leave-out residuals: residuals of rows that a fit omits, from the residuals of the fit to all rows.

    With W the omitted rows of an orthonormal basis of the columns, the residuals of the omitted rows are A⁻¹ times
    their residuals in the fit to all rows, A = I - W Wᵀ. If there are fewer columns than rows, A⁻¹ = I +
    W (I - WᵀW)⁻¹ Wᵀ.
    rows: indices of the omitted rows.
    there: rows W of the basis that are omitted.
    factor: Cholesky factor of A or, if smaller, I - WᵀW, for scipy's cho_solve.
    Source: Cook and Weisberg (1982), 2.2.
    """

    rows: IntArray
    there: Array
    factor: tuple[Array, bool]

    @classmethod
    def of(cls, rows: IntArray, basis: Array) -> "Omitted":
        """Prepare the residuals of a fit without `rows`, from an orthonormal basis of its columns."""
        there = basis[rows]
        square = there @ there.T if len(rows) <= basis.shape[1] else there.T @ there
        return cls(rows, there, factored(np.eye(len(square)) - square))

    def freed(self, values: Array) -> Array:
        """Return residuals of the omitted rows in a fit to the other rows. values: residuals in the fit to all rows."""
        if len(self.rows) <= self.there.shape[1]:
            return np.asarray(linalg.cho_solve(self.factor, values, check_finite=False))
        inside = linalg.cho_solve(self.factor, self.there.T @ values, check_finite=False)
        return np.asarray(values + self.there @ inside)
