"""Rows left out of a least-squares problem, by what all of it fits there."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from gpmodel.arrays import Array, IntArray
from gpmodel.numerics.least_squares import factored


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
