"""Newton's method for a platform on six links, and the rigid frames that it is written in.

Source: Merlet 2006, Parallel Robots, ch. 4 (Newton's method) and 5 (Jacobian).
"""

import numpy as np

from gpmodel.arrays import Array
from gpmodel.numerics import se3

STEPS = 50
"""Newton's method doubles the digits a step; a machine that needs more than this does not close."""

CLOSED = 1e-13
"""m; a length of a metre is a root of squares that double precision resolves to 2e-16 each."""

LONGEST_STEP = 0.1
"""m and rad a step of Newton's method: part of the machine's size, so that it stays in the assembly it starts from."""


def newton(pose: Array, lower: Array, balls: Array, lengths: Array) -> tuple[Array, Array]:
    """Pose (N, 4, 4) of the platform, from a start on, with its balls (6, N, 3) at `lengths` (6, N) from the lower
    ones, and by how much (N,) the worst misses, m."""
    miss = np.zeros_like(lengths)
    for _ in range(STEPS):
        upper = np.einsum("nij,knj->kni", pose[:, :3, :3], balls) + pose[:, :3, 3]
        miss = lengths - np.linalg.norm(upper - lower, axis=2)
        if np.abs(miss).max(initial=0.0) < CLOSED:
            break
        try:
            step = np.linalg.solve(jacobian_of(pose, lower, upper), miss.T[:, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            break
        longest = np.abs(step).max(axis=1, keepdims=True)
        pose = pose @ se3.exp(step * np.minimum(1.0, LONGEST_STEP / np.maximum(longest, LONGEST_STEP)))
    return pose, np.abs(miss).max(axis=0)


def jacobian_of(tool: Array, lower: Array, upper: Array) -> Array:
    """Rows (u, r × u), u along the link, of a twist of the tool in its own frame."""
    turn = tool[:, :3, :3]
    along = np.einsum("nji,knj->nki", turn, unit(upper - lower))
    arm = np.einsum("nji,knj->nki", turn, upper - tool[:, :3, 3])
    return np.concatenate([along, np.cross(arm, along)], axis=2)


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
