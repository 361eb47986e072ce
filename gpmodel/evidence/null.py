"""The null distribution: the residual permuted over independent poses."""

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import Linearised
from gpmodel.evidence.residual import Residual


def shuffled(residual: Residual, rng: np.random.Generator, count: int) -> Array:
    """Residuals (M + B, count) permuted over the poses, those that count as one together, then projected again."""
    out = np.repeat(residual.values[:, None], count, axis=1)
    measured = residual.values[: residual.measured]
    out[: residual.measured] = reordered(residual.problem, measured, residual.unit_of_pose, rng, count)
    return residual.span.remove(out)


def reordered(problem: Linearised, values: Array, unit: IntArray, rng: np.random.Generator, count: int) -> Array:
    """Values (M, count) of the rows (M,) of a problem with its poses in other orders; zero where the pose that comes
    there was not measured.

    unit: (N,) 0, 1, ... of the poses that stay together: whole units are put in another order, their poses one after
    the other into the places of the units in the old order.
    """
    present = problem.weights > 0
    blocks = np.zeros(present.shape)
    blocks[present] = values
    places = np.argsort(unit, kind="stable")
    out = np.empty((len(values), count))
    for b in range(count):
        turned = np.empty_like(blocks)
        turned[places] = blocks[np.argsort(np.argsort(rng.permutation(unit.max() + 1))[unit], kind="stable")]
        out[:, b] = turned[present]
    return out
