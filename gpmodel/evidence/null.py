"""The null distribution: the residual permuted over independent poses."""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.evidence.residual import Residual


def shuffled(residual: Residual, rng: np.random.Generator, count: int) -> Array:
    """Residuals (M + B, count) permuted over the poses, then projected again.

    Poses that count as one observation stay together: whole units are put in another order, their poses one after the
    other into the places of the units in the old order.
    """
    present = residual.problem.weights > 0
    blocks = np.zeros(present.shape)
    blocks[present] = residual.values[: residual.measured]
    out = np.repeat(residual.values[:, None], count, axis=1)
    unit = residual.unit_of_pose
    places = np.argsort(unit, kind="stable")
    for b in range(count):
        order = rng.permutation(unit.max() + 1)
        turned = np.empty_like(blocks)
        turned[places] = blocks[np.argsort(np.argsort(order)[unit], kind="stable")]
        rows = turned[present]
        out[: residual.measured, b] = np.where(np.isfinite(rows), rows, 0.0)
    return residual.span.remove(out)
