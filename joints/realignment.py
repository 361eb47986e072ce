"""Where a joint's passive angles come to rest when its tooling ball is held: least strain energy (thesis 3.3.2).

    E = ½ (X(q, ε) - p)ᵀ K (X(q, ε) - p),   q within a range about the angles that the joint would have without errors

X: the extended kinematics with the errors ε; p: where the ball is held; K: how stiffly. Free angles leave what changes
the ball's distance from the centre alone; of stiffness along one line, as of a link, the part along it.
"""

import numpy as np

from gpmodel.arrays import Array
from joints.kinematics import JOINTS, tooling_ball_position
from joints.limits import not_negative

STEPS, SETTLED = 50, 1e-10
"""Largest number of Gauss-Newton steps, and the change of every angle that ends them, rad: picometres at a lever."""
DIFFERENCE = 1e-5
"""rad, of the central differences; their error is ten digits below the lever."""
IDLE = 1e-3
"""Fraction of the lever per radian below which an angle is not turned, as a turn about the lever moves the ball by
nothing.
"""


def realigned(q: Array, parameters: Array, tooling_ball: Array, held: Array, reach: float, stiffness: Array) -> Array:
    """Angles (..., 3), rad, of least strain energy within `reach` [rad] of q (..., 3).

    parameters: (..., 30) m and rad. tooling_ball: (3,) m. held: (..., 3) m. stiffness: K (3, 3), any unit, symmetric.
    With K of largest eigenvalue 1, what is minimised is 2 E + (IDLE |tooling_ball|)² |turn|², by Gauss-Newton steps of
    the angles that no bound holds. Raises InputError for a negative reach or stiffness.
    """
    limit = float(not_negative("range of realignment", reach, "rad"))
    sizes, axes = np.linalg.eigh(stiffness)
    not_negative("stiffness", np.where(np.abs(sizes) < 1e-12 * np.abs(sizes).max(), 0.0, sizes), "N/m")
    root: Array = np.sqrt(np.maximum(sizes, 0.0) / sizes.max())[:, None] * axes.T
    idle, each = (IDLE * np.linalg.norm(tooling_ball)) ** 2, np.eye(len(JOINTS))

    def strained(turned: Array) -> Array:
        return (tooling_ball_position(q + turned, parameters, tooling_ball) - held) @ root.T

    turned = np.zeros(np.broadcast_shapes(q.shape, held.shape))
    for _ in range(STEPS):
        steps = DIFFERENCE * each
        columns = np.stack([strained(turned + d) - strained(turned - d) for d in steps], axis=-1) / (2 * DIFFERENCE)
        uphill = np.einsum("...ij,...i->...j", columns, strained(turned)) + idle * turned
        stopped = (np.abs(turned) >= limit) & (uphill * turned <= 0)
        curved = np.einsum("...ij,...ik->...jk", columns, columns) + idle * each
        curved = np.where(stopped[..., :, None] | stopped[..., None, :], each, curved)
        step = np.linalg.solve(curved, np.where(stopped, 0.0, uphill)[..., None])[..., 0]
        before, turned = turned, np.clip(turned - step, -limit, limit)
        if np.abs(turned - before).max() < SETTLED:
            break
    return q + turned
