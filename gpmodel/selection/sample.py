"""Which poses a selection chooses on, and what their states are."""

from dataclasses import replace

import numpy as np

from gpmodel.arrays import IntArray
from gpmodel.calibration.result import Calibration, resolved
from gpmodel.model.error_model import Poses, observe
from gpmodel.model.states import States

SCREENING_POSES = 1500
"""As many tell groups of a few nats from none; the numbers are fitted to all."""


def sample_of(bundle: IntArray) -> IntArray:
    """The poses to choose on: all, or whole bundles of about SCREENING_POSES evenly along the rows."""
    if len(bundle) <= SCREENING_POSES:
        return np.arange(len(bundle))
    share = SCREENING_POSES / len(bundle)
    numbers = np.unique(bundle)
    chosen = numbers[np.floor(np.arange(len(numbers)) * share) != np.floor((np.arange(len(numbers)) - 1) * share)]
    return np.flatnonzero(np.isin(bundle, chosen))


def predicted_states(calibration: Calibration, poses: Poses) -> States:
    """The states of poses, the instrument looking at where the model has them.

    Where it measured them is no input: a column that holds the noise, and lengths that take the arm away, explain it.
    """
    there = resolved(calibration, poses)
    observed = observe(calibration.model, there, calibration.theta, calibration.placement)
    if there.states.seen is None:
        return there.states
    points = there.states.seen.points.copy()
    points[slice(None) if there.states.rows is None else there.states.rows] = observed.tip[:, :3, 3]
    return replace(there.states, seen=replace(there.states.seen, points=points))
