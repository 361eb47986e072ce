"""A test for machines that are outliers among the machines of their type."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from gpmodel.arrays import Array, Mask
from gpmodel.hierarchy.block import BlockInformation, deleted_distances
from gpmodel.numerics.interval import SIGNIFICANCE, holm

SMALLEST = 1e-300
"""Smallest p-value that is distinguished from zero."""

FEWEST = 4
"""Least number of machines for the test for outlying machines. With three machines, the spread of the other two has one
degree of freedom, and no deviation is improbable."""


@dataclass(frozen=True)
class Deviations:
    """Deviation of each machine from the other machines, in each parameter or block of effects: one row per machine.

    z: deviation in units of the standard deviation that the other machines imply.
    chance: probability of a deviation at least as large for any machine of a fleet without outliers.
    inside: True if the machine is no outlier.
    """

    z: Array
    chance: Array
    inside: Mask


def deviations(told: Sequence[BlockInformation], machines: int) -> Deviations:
    """Test every machine against the other machines in every parameter or block of effects.

    The p-values (chances) are corrected for the number of machines and of parameters (Holm). While the smallest p-value
    is below SIGNIFICANCE, the machine with it becomes an outlier and the parameter is tested again without that
    machine, so that outliers do not mask each other. With fewer than FEWEST machines there are no outliers.
    """
    inside = np.ones((machines, len(told)), dtype=bool)
    z, chance = np.zeros(inside.shape), np.ones(inside.shape)
    if machines < FEWEST:
        return Deviations(z, chance, inside)
    stale = list(range(len(told)))
    while True:
        for k in stale:
            z[:, k], chance[:, k] = deleted_distances(told[k], inside[:, k])
        corrected = holm(chance)
        open_ones = np.where(inside & (inside.sum(axis=0) >= FEWEST), corrected, np.inf)
        i, k = (int(j) for j in np.unravel_index(int(np.argmin(open_ones)), chance.shape))
        if open_ones[i, k] >= SIGNIFICANCE:
            return Deviations(z, corrected, inside)
        inside[i, k] = False
        stale = [k]


def normal_score(z: float, chance: float) -> float:
    """Convert a corrected p-value to the equally improbable number of standard deviations of a normal distribution.

    The converted number has the sign of z. The score is small for machines that are no outliers.
    """
    return float(np.copysign(special.ndtri(0.5 * max(chance, SMALLEST)), z))
