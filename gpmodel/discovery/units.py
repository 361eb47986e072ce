"""Which poses count as one observation."""

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.discovery.criteria import Criteria
from gpmodel.table.bundles import bundles, replicates
from gpmodel.table.dataset import Dataset


def independent_units(dataset: Dataset, criteria: Criteria) -> IntArray:
    """Code (N,) of the poses that count as one observation, numbered as they first appear.

    Bundles of the table (groups and repeats); where these are too few to tell anything by permuting them, repeats of
    a pose alone.
    """
    codes = bundles(dataset)
    if codes.max(initial=-1) + 1 < criteria.fewest_bundles:
        codes = replicates(dataset)
    _, first, of_pose = np.unique(codes, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[of_pose.reshape(-1)].astype(np.int64)
