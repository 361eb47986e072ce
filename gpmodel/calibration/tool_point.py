"""Adapt a mechanism to the tool point of a first fit: the centre of the payload, and the lever of the last link."""

from collections.abc import Mapping

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.model.error_model import ErrorModel, Poses, prepare


def hang_payload(mechanism: Mechanism, poses: Poses) -> tuple[Mechanism, Poses]:
    """Attach the payload at the tool point, estimated by a fit of registration and tool alone.

    With several tools, the payload of a tool is at its tool point. A mechanism whose loads cannot be changed has one
    centre of mass c, with the least sum of squared moment errors Σ m² |c - t|² over the poses: m is the payload of a
    pose, t its tool point. A mechanism with a given centre of mass, without payload, or built in Python is unchanged.
    """
    if not isinstance(mechanism, LoadedMechanism) or mechanism.choice.payload_com is not None:
        return mechanism, poses
    if not np.any(poses.dataset.payload > 0):
        return mechanism, poses
    points = _tool_points(mechanism, poses)
    mechanism = mechanism.carrying_at(_middle(points, poses), points if len(points) > 1 else None)
    return mechanism, prepare(mechanism, poses.dataset)


def find_lever(mechanism: Mechanism, poses: Poses) -> Mechanism:
    """Extend the last link's lever to the tool point, estimated by a fit of registration and tool alone.

    Only a loaded mechanism with a lever changes; nominal frames do not change. The lever is the length that expands
    with temperature.
    """
    if not isinstance(mechanism, LoadedMechanism) or not hasattr(mechanism.bare, "reaching"):
        return mechanism
    return mechanism.reaching(_middle(_tool_points(mechanism, poses), poses))


def _tool_points(mechanism: Mechanism, poses: Poses) -> dict[str, Array]:
    """Return the point of each tool (3,), m, by a fit of registration and tool alone."""
    fit = calibrate(ErrorModel(mechanism, ()), poses)
    return {name: frame[:3, 3] for name, frame in fit.placement.tool.items()}


def _middle(points: Mapping[str, Array], poses: Poses) -> Array:
    """Return the mean of the tool points over the poses, with the squared payloads as weights."""
    carried = poses.dataset.payload
    each = np.array([points[name] for name in poses.dataset.label("tool").tolist()])
    return np.asarray(np.average(each, axis=0, weights=carried**2 if np.any(carried) else None))
