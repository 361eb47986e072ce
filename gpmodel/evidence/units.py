"""Which poses count as one observation."""

import numpy as np

from gpmodel.arrays import IntArray
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
