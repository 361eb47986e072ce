"""The null: the residual in another order of the poses, which is what chance looks like."""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.discovery.residual import Residual
from gpmodel.numerics import rank as ident


def shuffled(residual: Residual, rng: np.random.Generator, count: int) -> Array:
    """Residuals (M + B, count) permuted over the poses, then projected again."""
    present = residual.problem.weights > 0
    blocks = np.zeros(present.shape)
    blocks[present] = residual.values[: residual.measured]
    out = np.repeat(residual.values[:, None], count, axis=1)
    for b in range(count):
        rows = blocks[rng.permutation(len(blocks))][present]
        out[: residual.measured, b] = np.where(np.isfinite(rows), rows, 0.0)
    return ident.remove(residual.enabled, out)
