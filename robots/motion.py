"""Homogeneous transforms (..., 4, 4) of elementary motions, metres and radians."""

import numpy as np
from numpy.typing import ArrayLike

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import AXES
from gpmodel.numerics import se3


def along(axis: str, value: float) -> Array:
    """Transform (4, 4) of one motion by value, rad about or m along the axis, one of AXES."""
    return np.asarray(se3.along(AXES.index(axis), np.array([value]))[0])


def placement(xyz: ArrayLike, rpy: ArrayLike) -> Array:
    """Transform (4, 4) that turns by Rz(yaw) Ry(pitch) Rx(roll), rad, and moves by xyz (3,), m."""
    roll, pitch, yaw = np.asarray(rpy, dtype=np.float64)
    return se3.shift(xyz) @ along("Rz", yaw) @ along("Ry", pitch) @ along("Rx", roll)
