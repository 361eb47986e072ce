"""A payload hangs at the tool point, which nobody knows before a first fit."""

import dataclasses

import numpy as np

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import ErrorModel, Poses, prepare


def hang_payload(
    choice: MechanismChoice, mechanism: Mechanism, poses: Poses
) -> tuple[MechanismChoice, Mechanism, Poses]:
    """The same poses with the payload at the tool point that registration and tool alone give.

    Nothing changes where a centre of mass was given, or where nothing is carried.
    """
    if choice.payload_com is not None or not np.any(poses.dataset.payload > 0):
        return choice, mechanism, poses
    fit = calibrate(ErrorModel(mechanism, ()), poses)
    point = np.mean([frame[:3, 3] for frame in fit.placement.tool.values()], axis=0)
    choice = dataclasses.replace(choice, payload_com=tuple(float(v) for v in point))
    mechanism = choice.load()
    return choice, mechanism, prepare(mechanism, poses.dataset)
