"""A pose that a measurement has to find of itself: six numbers, moved by twists in its own axes."""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.numerics import se3


def frame_of(value: Array) -> Array:
    """Transform (4, 4) of six numbers: place (3,), m, and rotation vector (3,), rad."""
    out = se3.exp(np.concatenate([np.zeros(3), value[3:6]]))
    out[:3, 3] = value[:3]
    return out


def numbers_of(frame: Array) -> Array:
    """The six numbers of a transform (4, 4)."""
    return np.concatenate([frame[:3, 3], se3.rotation_vector(frame[:3, :3])])


def turned(value: Array, twist: Array) -> Array:
    """The six numbers after a twist (6,), m and rad, in the pose's own axes: T exp(twist)."""
    return numbers_of(frame_of(value) @ se3.exp(twist))


def by_pose(points: Array) -> Array:
    """Change (N, 3, 6) of points (N, 3) that stand still, seen in a frame, per unit twist of that frame in its own
    axes: y' = exp(-ξ) y."""
    return np.concatenate([np.broadcast_to(-np.eye(3), (len(points), 3, 3)), se3.hat(points)], axis=2)
