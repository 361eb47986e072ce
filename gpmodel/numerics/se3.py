"""Rigid motions, vectorised over poses. Transforms are (..., 4, 4); a twist is (Tx, Ty, Tz, Rx, Ry, Rz)."""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array
from gpmodel.numerics import se3

JACOBIAN_TERMS = 16
"""Terms of the series of the Jacobian: exact to rounding for turns up to 1 rad, far beyond every error twist."""


def hat(vectors: Array) -> Array:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3): hat(a) @ b = a × b."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    out = np.zeros((*vectors.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def exp(twists: Array) -> Array:
    """Exponential of twists (..., 6) in metres and radians: (..., 4, 4).

    R = I + a W + b W², p = (I + b W + c W²) v with W = hat(w), a = sin t / t, b = (1 - cos t) / t²,
    c = (t - sin t) / t³; below t = 1e-4 the series. Source: Murray, Li, Sastry (1994), eq. 2.36.
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
    """Right Jacobian (..., 6, 6) of the exponential: exp(ξ + dξ) = exp(ξ) exp(J dξ) to first order in dξ.

    J = Σ (-ad)ᵏ / (k + 1)!, with ad of twists (..., 6) in metres and radians, up to the first term that is rounding
    everywhere; a twist that is the same everywhere is worked out once.
    Source: Barfoot (2017), State Estimation for Robotics, 7.1.5.
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
    """Rotation vectors (..., 3), rad, of rotation matrices (..., 3, 3)."""
    flat: Array = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_rotvec()
    return flat.reshape(*rotations.shape[:-2], 3)


def vector_change(vectors: Array) -> Array:
    """Change (..., 3, 3) of rotation vectors φ (..., 3), rad, by a small turn about the outer axes: the inverse left
    Jacobian

        J⁻¹ = I - W / 2 + (1 - (t / 2) cot(t / 2)) W² / t²,  W = hat(φ), t = |φ| up to π.

    Source: Barfoot (2017), State Estimation for Robotics, eq. 7.76.
    """
    cross = hat(vectors)
    t = np.linalg.norm(vectors, axis=-1)
    small = t < 1e-4
    safe = np.where(small, 1.0, t)
    factor = np.where(small, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    return np.asarray(np.eye(3) - 0.5 * cross + factor[..., None, None] * (cross @ cross))


def frame(turn: Array, place: ArrayLike) -> Array:
    """Transform (4, 4) of a rotation (3, 3) and a place (3,), m."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, place
    return out


def shift(points: ArrayLike) -> Array:
    """Transforms (..., 4, 4) that move by points (..., 3), m."""
    points = np.asarray(points, dtype=float)
    out = np.broadcast_to(np.eye(4), (*points.shape[:-1], 4, 4)).copy()
    out[..., :3, 3] = points
    return out


def along(axis: int, values: Array) -> Array:
    """Transforms (N, 4, 4) by values (N,), m along or rad about a coordinate axis, by its number among those of a
    twist."""
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
    """The rotation (3, 3) nearest to a matrix in the least-squares sense. Source: Kabsch (1976)."""
    u, _, vt = np.linalg.svd(rough)
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0]) @ vt)


def chain(transforms: Array) -> Array:
    """Running products (S, N, 4, 4) of relative transforms: each frame in the root."""
    out = np.empty_like(transforms)
    out[0] = transforms[0]
    for i in range(1, len(transforms)):
        np.matmul(out[i - 1], transforms[i], out=out[i])
    return out


def fit_rotation(source: Array, target: Array) -> tuple[Array, Array]:
    """Rotation R and translation t with target ≈ R source + t in the least-squares sense.

    source, target: (N, 3) metres.
    """
    a, b = source.mean(axis=0), target.mean(axis=0)
    turn = nearest_rotation((target - b).T @ (source - a))
    return turn, b - turn @ a


def roll_pitch_yaw(rotation: Array) -> Array:
    """The angles (3,), rad, of Rz(yaw) Ry(pitch) Rx(roll) for a rotation (3, 3); at a pitch of a right angle only the
    sum of roll and yaw is determined; the yaw is chosen and the roll follows."""
    r = rotation
    yaw = np.arctan2(r[1, 0], r[0, 0])
    pitch = np.arctan2(-r[2, 0], np.hypot(r[0, 0], r[1, 0]))
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([np.arctan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1]), pitch, yaw])


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
