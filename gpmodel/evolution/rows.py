"""Rows of values of many basis functions: scaling, products, and linear independence."""

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array


def unit_rows(values: Array) -> Array:
    """Return rows divided by their largest magnitude; a row with a number that is not finite becomes zero."""
    with np.errstate(invalid="ignore"):
        scale = np.maximum(values.max(axis=1, initial=0.0), -values.min(axis=1, initial=0.0))
    usable = np.isfinite(scale) & (scale > 0)
    scaled: Array = values / np.where(usable, scale, 1.0)[:, None]
    scaled[~usable] = 0.0
    return scaled


def row_products(first: Array, second: Array) -> Array:
    """Return the scalar product of each row of one table with the row of another; a table may have one row for all."""
    few, many = (first, second) if len(first) == 1 else (second, first)
    return np.asarray(many @ few[0] if len(few) == 1 else np.einsum("pk,pk->p", first, second))


def independent(gram: Array, total: Array, limit: float) -> NDArray[np.intp]:
    """Return the numbers of linearly independent rows of a Gram matrix, by pivoted Cholesky decomposition.

    total: squared norms of the rows before any projection. A row is left out if its part orthogonal to the selected
    rows is below ``limit`` of its squared norm.
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
