"""Rows of values of many bases: scaled, multiplied, and which of them are independent."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array


def unit_rows(values: Array) -> Array:
    """Rows divided by their largest magnitude; rows with a number that is not finite become zero."""
    with np.errstate(invalid="ignore"):
        scale = np.maximum(values.max(axis=1, initial=0.0), -values.min(axis=1, initial=0.0))
    usable = np.isfinite(scale) & (scale > 0)
    scaled: Array = values / np.where(usable, scale, 1.0)[:, None]
    scaled[~usable] = 0.0
    return scaled


def row_products(first: Array, second: Array) -> Array:
    """Products (P,) of the rows (P, K) of two tables, of which one may have a single row for all."""
    few, many = (first, second) if len(first) == 1 else (second, first)
    return np.asarray(many @ few[0] if len(few) == 1 else np.einsum("pk,pk->p", first, second))


def independent(gram: Array, total: Array, limit: float) -> NDArray[np.intp]:
    """Rows of a Gram matrix that are independent, by pivoted Cholesky.

    ``total`` holds the squared norms before anything was projected out; a row is left out where the part of
    it that is new is below ``limit`` of that.
    """
    remaining = gram.astype(float).copy()
    chosen: list[int] = []
    for _ in range(len(gram)):
        share = np.where(total > 0, np.diag(remaining) / np.where(total > 0, total, 1.0), 0.0)
        share[chosen] = 0.0
        pivot = int(np.argmax(share))
        if share[pivot] <= limit:
            break
        chosen.append(pivot)
        column = remaining[:, pivot] / np.sqrt(remaining[pivot, pivot])
        remaining -= np.outer(column, column)
    return np.array(sorted(chosen), dtype=np.intp)
