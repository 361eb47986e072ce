"""Rigid motions, vectorised over poses: transforms (..., 4, 4) and twists (Tx, Ty, Tz, Rx, Ry, Rz) in m and rad."""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array

JACOBIAN_TERMS = 16
"""Number of series terms of the Jacobian: exact to rounding for rotations up to 1 rad, above every error twist."""


def hat(vectors: Array) -> Array:
    """Return cross-product matrices (..., 3, 3) of vectors (..., 3): hat(a) @ b = a × b."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    out = np.zeros((*vectors.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def exp(twists: Array) -> Array:
    """Return the exponential (..., 4, 4) of twists (..., 6) in metres and radians.

    For a twist (v, w), R = I + a W + b W², p = (I + b W + c W²) v, W = hat(w), t = |w|, a = sin t / t, b = (1 - cos t)
    / t², c = (t - sin t) / t³; a series below t = 1e-4. Source: Murray, Li, Sastry (1994), equation 2.36.
    """
    v, w = twists[..., :3], twists[..., 3:]
    t2 = np.sum(w * w, axis=-1)
    small = t2 < 1e-8
    t = np.sqrt(np.where(small, 1.0, t2))
    a = np.where(small, 1 - t2 / 6, np.sin(t) / t)[..., None, None]
    b = np.where(small, 0.5 - t2 / 24, (1 - np.cos(t)) / t**2)[..., None, None]
    c = np.where(small, 1 / 6 - t2 / 120, (t - np.sin(t)) / t**3)[..., None, None]
    cross = hat(w)
    square = cross @ cross
    out = np.zeros((*twists.shape[:-1], 4, 4))
    out[..., :3, :3] = np.eye(3) + a * cross + b * square
    out[..., :3, 3] = v + ((b * cross + c * square) @ v[..., None])[..., 0]
    out[..., 3, 3] = 1.0
    return out


def right_jacobian(twists: Array) -> Array:
    """Return the right Jacobian J (..., 6, 6) of the exponential: exp(ξ + dξ) = exp(ξ) exp(J dξ) to first order in dξ.

    J is Σ (-ad)ᵏ / (k + 1)! over k from 0, with the adjoint matrix ad of each twist (..., 6) in metres and radians. The
    series ends where its terms are below rounding at every pose. If all twists are equal, J is computed once. Source:
    Barfoot (2017), State Estimation for Robotics, 7.1.5.
    """
    flat = twists.reshape(-1, 6)
    if len(flat) > 1 and not np.ptp(flat, axis=0).any():
        return np.broadcast_to(right_jacobian(flat[0]), (*twists.shape, 6))
    turn, slide = hat(twists[..., 3:]), hat(twists[..., :3])
    ad = np.zeros((*twists.shape, 6))
    ad[..., :3, :3], ad[..., :3, 3:], ad[..., 3:, 3:] = turn, slide, turn
    size = float(np.sqrt(np.max(np.sum(ad**2, axis=(-2, -1)), initial=0.0)))
    small = (k for k in range(1, JACOBIAN_TERMS) if size**k < np.finfo(float).eps / 8 * math.factorial(k + 1))
    out = np.broadcast_to(np.eye(6), ad.shape)
    for k in range(next(small, JACOBIAN_TERMS), 1, -1):
        out = np.eye(6) - ad @ out / k
    return np.asarray(out)


def rotation_vector(rotations: Array) -> Array:
    """Return rotation vectors (..., 3), rad, of rotation matrices (..., 3, 3)."""
    flat: Array = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_rotvec()
    return flat.reshape(*rotations.shape[:-2], 3)


def vector_change(vectors: Array) -> Array:
    """Return the inverse left Jacobian (..., 3, 3) of rotation vectors φ (..., 3), rad.

    The Jacobian is the derivative of φ with respect to a small rotation about the axes of the outer frame:

    J⁻¹ = I - W / 2 + (1 - (t / 2) cot(t / 2)) W² / t²,  W = hat(φ), t = |φ| up to π.

    Source: Barfoot (2017), State Estimation for Robotics, equation 7.76.
    """
    cross = hat(vectors)
    t = np.linalg.norm(vectors, axis=-1)
    small = t < 1e-4
    safe = np.where(small, 1.0, t)
    factor = np.where(small, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    return np.asarray(np.eye(3) - 0.5 * cross + factor[..., None, None] * (cross @ cross))


def frame(turn: Array, place: ArrayLike) -> Array:
    """Return the transform (4, 4) of a rotation (3, 3) and a position (3,), m."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, place
    return out


def shift(points: ArrayLike) -> Array:
    """Return pure translations (..., 4, 4) by vectors (..., 3), m."""
    points = np.asarray(points, dtype=float)
    out = np.broadcast_to(np.eye(4), (*points.shape[:-1], 4, 4)).copy()
    out[..., :3, 3] = points
    return out


def along(axis: int, values: Array) -> Array:
    """Return transforms by values along or about a coordinate axis.

    axis: index of a twist component; 0 to 2 translate along x, y, z, m; 3 to 5 rotate about x, y, z, rad.
    """
    out = shift(np.zeros((len(values), 3)))
    if axis < 3:
        out[:, axis, 3] = values
    else:
        i, j = (axis - 2) % 3, (axis - 1) % 3
        out[:, i, i] = out[:, j, j] = np.cos(values)
        out[:, j, i] = np.sin(values)
        out[:, i, j] = -out[:, j, i]
    return out


def nearest_rotation(rough: Array) -> Array:
    """Return the rotation (3, 3) nearest to a matrix in the least-squares sense. Source: Kabsch (1976)."""
    u, _, vt = np.linalg.svd(rough)
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0]) @ vt)


def chain(transforms: Array) -> Array:
    """Multiply relative transforms to the pose of each frame in the root frame."""
    out = np.empty_like(transforms)
    out[0] = transforms[0]
    for i in range(1, len(transforms)):
        np.matmul(out[i - 1], transforms[i], out=out[i])
    return out


def fit_rotation(source: Array, target: Array) -> tuple[Array, Array]:
    """Return rotation R and translation t of the least-squares fit target ≈ R source + t.

    source, target: points, m.
    """
    a, b = source.mean(axis=0), target.mean(axis=0)
    turn = nearest_rotation((target - b).T @ (source - a))
    return turn, b - turn @ a


def without_registration(points: Array, columns: Array) -> Array:
    """Project a common translation and rotation of points out of the points' displacements by parameters.

    The projected displacement is minus the derivative of the residual of `fit_rotation` with respect to the parameters,
    without a term that is proportional to the residual. Source: Kaufman (1975), variable projection.
    """
    columns, arms = columns - columns.mean(axis=0), hat(points - points.mean(axis=0)).reshape(-1, 3)
    flat = columns.reshape(len(arms), -1)
    turns = np.linalg.pinv(arms.T @ arms, hermitian=True) @ (arms.T @ flat)
    return np.asarray(flat - arms @ turns).reshape(columns.shape)


def roll_pitch_yaw(rotation: Array) -> Array:
    """Return the angles (3,), rad, of Rz(yaw) Ry(pitch) Rx(roll) for a rotation (3, 3).

    At a pitch of ±90° only the sum or difference of roll and yaw is determined; a yaw is chosen arbitrarily.
    """
    r = rotation
    yaw = np.arctan2(r[1, 0], r[0, 0])
    pitch = np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0]))
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([np.arctan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1]), pitch, yaw])


def frame_of(value: Array) -> Array:
    """Return the transform (4, 4) of a pose as six numbers: position (3,), m, and rotation vector (3,), rad."""
    out = exp(np.concatenate([np.zeros(3), value[3:6]]))
    out[:3, 3] = value[:3]
    return out


def numbers_of(frame: Array) -> Array:
    """Return a transform (4, 4) as six numbers: position (3,), m, and rotation vector (3,), rad."""
    return np.concatenate([frame[:3, 3], rotation_vector(frame[:3, :3])])


def turned(value: Array, twist: Array) -> Array:
    """Return a pose as six numbers after a twist (6,), m and rad, about its own axes: T exp(twist)."""
    return numbers_of(frame_of(value) @ exp(twist))


def by_pose(points: Array) -> Array:
    """Return the derivative of points y with respect to a unit twist ξ of the frame of their coordinates.

    The points do not move with the frame, and ξ is in the axes of the frame: y' = exp(-ξ) y.
    """
    return np.concatenate([np.broadcast_to(-np.eye(3), (len(points), 3, 3)), hat(points)], axis=2)
