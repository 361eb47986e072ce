"""Newton's method for a platform on six links, and the rigid frames that it is written in.

Source: Merlet 2006, Parallel Robots, ch. 4 (Newton's method) and 5 (Jacobian).
"""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.numerics import se3

STEPS = 50
"""Largest number of Newton steps. Each doubles the digits; a machine that needs more does not close."""

PROGRESS, STALLED = 0.9, 6
"""A pose is given up after so many steps in which its largest gap has not fallen by a tenth: it has left its assembly.
At half no pose of 2161 with tilts up to 15 deg is lost and one of 671 at 45 deg; at double a pose that cannot close
takes twice the time."""

CLOSED = 1e-13
"""Largest gap of a closed loop, m. A length of a metre is a root of squares with a rounding of 2e-16 each."""

LONGEST_STEP = 0.1
"""Longest step of Newton's method, m and rad: a part of the machine's size, so that it stays in its assembly."""


def newton(pose: Array, lower: Array, balls: Array, lengths: Array) -> tuple[Array, Array]:
    """Pose (N, 4, 4) of the platform, from a start on, with its balls (6, N, 3) at `lengths` (6, N) from the lower
    ones, and by how much (N,) the worst misses, m.

    Each pose takes steps until it is closed or has stalled.
    """
    pose, lower, balls, lengths = pose.copy(), *(np.swapaxes(part, 0, 1) for part in (lower, balls, lengths))
    miss, best, stalled = np.full(len(pose), np.inf), np.full(len(pose), np.inf), np.zeros(len(pose), dtype=int)
    rows = np.arange(len(pose))
    for _ in range(STEPS):
        turn, at = pose[rows, :3, :3], pose[rows, :3, 3]
        vectors = balls[rows] @ np.swapaxes(turn, 1, 2) + (at[:, None] - lower[rows])
        long = np.sqrt(np.einsum("nki,nki->nk", vectors, vectors))
        short = lengths[rows] - long
        miss[rows] = np.abs(short).max(axis=1)
        stalled[rows] = np.where(miss[rows] < PROGRESS * best[rows], 0, stalled[rows] + 1)
        best[rows] = np.minimum(best[rows], miss[rows])
        go = np.flatnonzero((miss[rows] >= CLOSED) & (stalled[rows] < STALLED))
        if not len(go):
            break
        rows = rows[go]
        along = (vectors[go] / long[go, :, None]) @ turn[go]
        try:
            step = np.linalg.solve(wrenches(along, balls[rows]), short[go, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            break
        longest = np.abs(step).max(axis=1, keepdims=True)
        pose[rows] = pose[rows] @ se3.exp(step * (LONGEST_STEP / np.maximum(longest, LONGEST_STEP)))
    return pose, miss


def wrenches(along: Array, arm: Array) -> Array:
    """Rows (..., 6) of unit directions u (..., 3) and their moments r × u at arms r (..., 3)."""
    (x, y, z), (u, v, w) = np.moveaxis(arm, -1, 0), np.moveaxis(along, -1, 0)
    return np.stack([u, v, w, y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def jacobian_of(tool: Array, lower: Array, upper: Array) -> Array:
    """Rows (u, r × u), u along the link, of a twist of the tool in its own frame."""
    turn = tool[:, :3, :3]
    along = np.einsum("nji,knj->nki", turn, unit(upper - lower))
    arm = np.einsum("nji,knj->nki", turn, upper - tool[:, :3, 3])
    return wrenches(along, arm)


def unit(vectors: Array) -> Array:
    """Vectors (..., 3) of length one."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def axes_along(directions: Array) -> Array:
    """Axes (..., 3, 3) with z along unit vectors (..., 3): the smallest turn of the root's; none points to -z."""
    v = np.stack([-directions[..., 1], directions[..., 0], np.zeros(directions.shape[:-1])], axis=-1)
    turn = se3.hat(v.reshape(-1, 3)).reshape(*directions.shape, 3)
    return np.eye(3) + turn + turn @ turn / (1.0 + directions[..., 2])[..., None, None]


def adjoint(frame: Array) -> Array:
    """Twists (N, 6, 6) of a body in its own axes by those of another frame, placed at `frame` (N, 4, 4) in it."""
    out = np.zeros((len(frame), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = frame[:, :3, :3]
    out[:, :3, 3:] = se3.hat(frame[:, :3, 3]) @ frame[:, :3, :3]
    return out
