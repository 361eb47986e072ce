"""Sensitivities to parameters at the nominal geometry, before any measurement."""

import numpy as np

from gpmodel.calibration.gauss_newton import ROTATION_WEIGHT
from gpmodel.calibration.linearise import Linearised, linearise
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Placement, prepare
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset

TOOL_POINT = (0.05, 0.07, 0.11)
"""Metres from the flange: off every axis, so that the last joint's errors show."""
CONDITION_LIMIT = 1e4
"""Condition number beyond which combinations of errors are one: rounding in joint values of a controller's display."""


def linearised_at_nominal(mechanism: Mechanism, effects: tuple[Effect, ...], data: Dataset) -> Linearised:
    """The linear problem of registration, tool, anchors and effects, all zero, at the poses of a table.

    Of what was measured only its kind matters (finite or NaN); each distance has an anchor two metres away.
    """
    anchors = {name: np.array([2.0, 0.3 + i, 0.1]) for i, name in enumerate(data.distances)}
    model, placement = ErrorModel(mechanism, effects), Placement({"": np.eye(4)}, {"": se3.shift(TOOL_POINT)}, anchors)
    use = np.ones(len(data), dtype=bool)
    return linearise(model, prepare(mechanism, data), np.zeros(len(effects)), placement, ROTATION_WEIGHT, use)
