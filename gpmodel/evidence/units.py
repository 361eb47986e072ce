"""Which poses count as one observation, and values permuted over these."""

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.calibration.linearise import Linearised
from gpmodel.evidence.criteria import Criteria
from gpmodel.table.bundles import bundles, replicates
from gpmodel.table.dataset import Dataset
from gpmodel.table.split import stretches


def independent_units(dataset: Dataset, criteria: Criteria) -> IntArray:
    """Code (N,) of the poses that count as one observation, numbered as they first appear.

    Bundles of the table (groups and repeats); where these are too few to tell anything by permuting them, what was
    read at one pose alone.
    """
    codes = bundles(dataset)
    if codes.max(initial=-1) + 1 < criteria.fewest_bundles:
        codes = replicates(dataset, whatever=bool(dataset.observations))
    _, first, of_pose = np.unique(codes, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[of_pose.reshape(-1)].astype(np.int64)


def exchangeable(dataset: Dataset, criteria: Criteria) -> IntArray:
    """Code (N,) of the poses that stay together where chance puts the others in another order.

    Independent units; of poses measured once each and in order, stretches of rows, so that what one row has from the
    row before is kept. Source: Künsch (1989), blocks.
    """
    unit = independent_units(dataset, criteria)
    count = len(dataset)
    if not dataset.in_order or unit.max(initial=-1) + 1 < count or count < 2 * criteria.fewest_bundles:
        return unit
    return stretches(dataset.row.astype(float), criteria.fewest_bundles)


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
