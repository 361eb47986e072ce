"""Newton's method for the pose of a platform on six links, and the rigid frames that it uses.

Source: Merlet 2006, Parallel Robots, ch. 4 (Newton's method) and 5 (Jacobian).
"""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.numerics import se3

STEPS = 50
"""Largest number of Newton steps. Each doubles the number of digits; a machine that needs more does not close."""

PROGRESS, STALLED = 0.9, 6
"""Newton's method gives up after STALLED steps without a fall of the largest gap by a tenth: the pose has left its
assembly. At half, no pose of 2161 with tilts up to 15 deg is lost and one of 671 at 45 deg; at double, a pose that
cannot close takes twice the time."""

CLOSED = 1e-13
"""Largest gap of a closed loop, m. A length of a metre is a root of squares with a rounding of 2e-16 each."""

LONGEST_STEP = 0.1
"""Longest step of Newton's method, m and rad: a part of the machine's size, so that the pose stays in its assembly."""


def newton(pose: Array, lower: Array, balls: Array, lengths: Array) -> tuple[Array, Array]:
    """Find the pose (N, 4, 4) of a platform by Newton's method; return it and the largest gap (N,) of a link, m.

    pose: (N, 4, 4) to start from.
    lower: centres (6, N, 3) of the lower balls. balls: centres (6, N, 3) of the balls on the platform, in its frame.
    lengths: (6, N) of the links, m.
    Steps end for each pose when it is closed or has stalled.
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
    """Return rows (..., 6) of unit directions u (..., 3) and their moments r × u at arms r (..., 3)."""
    (x, y, z), (u, v, w) = np.moveaxis(arm, -1, 0), np.moveaxis(along, -1, 0)
    return np.stack([u, v, w, y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def jacobian_of(tool: Array, lower: Array, upper: Array) -> Array:
    """Return the derivatives (N, 6, 6) of the link lengths by a twist of the tool in its own frame.
    Rows are (u, r × u) with u along the link."""
    turn = tool[:, :3, :3]
    along = np.einsum("nji,knj->nki", turn, unit(upper - lower))
    arm = np.einsum("nji,knj->nki", turn, upper - tool[:, :3, 3])
    return wrenches(along, arm)


def unit(vectors: Array) -> Array:
    """Return vectors (..., 3) scaled to length one."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def axes_along(directions: Array) -> Array:
    """Return rotations (..., 3, 3) with z along unit vectors (..., 3), the smallest rotations from the root axes.
    No vector may point along -z."""
    v = np.stack([-directions[..., 1], directions[..., 0], np.zeros(directions.shape[:-1])], axis=-1)
    turn = se3.hat(v.reshape(-1, 3)).reshape(*directions.shape, 3)
    return np.eye(3) + turn + turn @ turn / (1.0 + directions[..., 2])[..., None, None]


def adjoint(frame: Array) -> Array:
    """Return the matrices (N, 6, 6) that convert twists in one frame to twists of a body in its own axes.
    frame: (N, 4, 4), the frame in the frame of the body."""
    out = np.zeros((len(frame), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = frame[:, :3, :3]
    out[:, :3, 3:] = se3.hat(frame[:, :3, 3]) @ frame[:, :3, :3]
    return out
