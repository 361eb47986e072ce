"""Homogeneous transforms (..., 4, 4) of elementary motions, metres and radians."""

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import AXES


def axis_motion(axis: str, value: Array) -> Array:
    """Transforms (N, 4, 4) of a motion by value (N,), rad about or m along the axis, one of AXES."""
    transforms = np.zeros((len(value), 4, 4))
    transforms[:] = np.eye(4)
    index = AXES.index(axis)
    if index < 3:
        transforms[:, index, 3] = value
    else:
        i, j = (index - 2) % 3, (index - 1) % 3
        transforms[:, i, i] = transforms[:, j, j] = np.cos(value)
        transforms[:, j, i] = np.sin(value)
        transforms[:, i, j] = -transforms[:, j, i]
    return transforms


def translation(vector: ArrayLike) -> Array:
    """Transform (4, 4) by vector (3,), m."""
    transform = np.eye(4)
    transform[:3, 3] = vector
    return transform


def along(axis: str, value: float) -> Array:
    """Transform (4, 4) of one motion by value, rad about or m along the axis, one of AXES."""
    motion: Array = axis_motion(axis, np.array([value]))[0]
    return motion


def placement(xyz: ArrayLike, rpy: ArrayLike) -> Array:
    """Transform (4, 4) that turns by Rz(yaw) Ry(pitch) Rx(roll), rad, and moves by xyz (3,), m."""
    roll, pitch, yaw = np.asarray(rpy, dtype=np.float64)
    return translation(xyz) @ along("Rz", yaw) @ along("Ry", pitch) @ along("Rx", roll)
