"""Estimates from a first fit: the position of a payload, and the length of a joint's lever."""

import numpy as np

from gpmodel.arrays import Array
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
    mechanism = mechanism.carrying_at(_tool_point(mechanism, poses))
    return mechanism, prepare(mechanism, poses.dataset)


def find_lever(mechanism: Mechanism, poses: Poses) -> Mechanism:
    """The mechanism with its lever up to the tool point that registration and tool alone give.

    Nothing changes but for a loaded mechanism that has a lever: the nominal frames stay, what grows with temperature
    is the lever that is there.
    """
    if not isinstance(mechanism, LoadedMechanism) or not hasattr(mechanism.bare, "reaching"):
        return mechanism
    return mechanism.reaching(_tool_point(mechanism, poses))


def _tool_point(mechanism: Mechanism, poses: Poses) -> Array:
    fit = calibrate(ErrorModel(mechanism, ()), poses)
    return np.asarray(np.mean([frame[:3, 3] for frame in fit.placement.tool.values()], axis=0))
