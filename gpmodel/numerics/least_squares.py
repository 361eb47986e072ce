"""Least squares of unit columns: few by pivoted QR, many by factored normal equations."""

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array

MANY_COLUMNS = 100
"""So many only priors bring, which keep normal equations regular; and those are far faster than pivoted QR."""


def solve(system: Array, target: Array) -> Array:
    """x (K,) or (K, R) that minimises |A x - b|² for unit columns A (M, K): by pivoted QR, or by normal equations where
    hundreds of priors keep them regular."""
    if system.shape[1] < MANY_COLUMNS:
        return linalg.lstsq(system, target, cond=1e-10, lapack_driver="gelsy", check_finite=False)[0]
    return linalg.cho_solve(factored(system.T @ system), system.T @ target, check_finite=False)


def factored(gram: Array) -> tuple[Array, bool]:
    """Cholesky factor, for scipy's cho_solve, of the normal matrix (K, K) of unit columns, which it overwrites.

    Row by row in memory it is its own transpose column by column, as LAPACK wants it.
    """
    gram[np.diag_indices_from(gram)] += 1e-12
    return linalg.cho_factor(gram.T, overwrite_a=True, check_finite=False)


def inverse_gram(columns: Array, many: bool) -> Array:
    """(CᵀC)⁻¹ (K, K) of unit columns: a pseudo-inverse by QR, or by Cholesky where priors keep hundreds regular."""
    if many:
        return linalg.cho_solve(factored(columns.T @ columns), np.eye(columns.shape[1]), check_finite=False)
    root = np.linalg.pinv(np.linalg.qr(columns, mode="r"), rcond=1e-9)
    return root @ root.T


def root_mean_square(values: Array) -> float:
    """√ mean v² of values (N,); NaN of none."""
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")
