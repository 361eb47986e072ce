"""A payload hangs at the tool point, which nobody knows before a first fit."""

import numpy as np

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.model.error_model import ErrorModel, Poses, prepare


def hang_payload(mechanism: Mechanism, poses: Poses) -> tuple[Mechanism, Poses]:
    """The mechanism and the same poses with the payload at the tool point that registration and tool alone give.

    Nothing changes where a centre of mass was given, where nothing is carried, or for a mechanism built in Python,
    whose payload is where it says.
    """
    if not isinstance(mechanism, LoadedMechanism) or mechanism.choice.payload_com is not None:
        return mechanism, poses
    if not np.any(poses.dataset.payload > 0):
        return mechanism, poses
    fit = calibrate(ErrorModel(mechanism, ()), poses)
    mechanism = mechanism.carrying_at(np.mean([frame[:3, 3] for frame in fit.placement.tool.values()], axis=0))
    return mechanism, prepare(mechanism, poses.dataset)
