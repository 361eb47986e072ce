"""Fit a blind robot with the true form of its effects (the oracle).

Unknowns: rotation and translation of the registration (6), tool point (3), a constant small motion of the frame of
every joint (6 n), one amount for every column of the effects.  Gauss-Newton; the columns are scaled to unit length and
the singular values below `CUT` times the largest are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from experiments.blind.shapes import Motion, combine
from experiments.blind.simulator import INSTRUMENT, Arm, Array, frames, points, small_motion

CUT = 2e-3
SHORT_TOOL = 1e-4


def register(arm: Arm, q: Array, measured: Array) -> tuple[Array, Array]:
    """Placement (4, 4) and tool (3,) of the nominal arm: best rigid motion of the flange, then both together.

    Where joints that stand still or are parallel leave the tool open, the shortest.
    """
    flange = frames(arm, q)[-1]
    origin = flange[:, :3, 3]
    left, _, right = np.linalg.svd((measured - measured.mean(0)).T @ (origin - origin.mean(0)))
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    placement = np.eye(4)
    placement[:3, :3] = left @ proper @ right
    placement[:3, 3] = measured.mean(0) - placement[:3, :3] @ origin.mean(0)

    def moved(x: Array) -> Array:
        return placement @ small_motion(np.concatenate([x[3:6], x[:3]])[None])[0]

    def residual(x: Array) -> Array:
        at = moved(x)
        error = (flange[:, :3, :3] @ x[6:] + origin) @ at[:3, :3].T + at[:3, 3] - measured
        return np.append(error, SHORT_TOOL * x[6:])

    solution = least_squares(residual, np.zeros(9), method="lm").x
    return moved(solution), solution[6:]


@dataclass(frozen=True)
class Fit:
    """placement (4, 4), tool (3,), amounts: 6 of registration, 3 of tool, 6 n of the joints, then the effects."""

    arm: Arm
    placement: Array
    tool: Array
    amounts: Array

    def predict(self, q: Array, columns: list[Motion]) -> Array:
        """(N, 3) points in the tracker for poses whose effect columns are given."""
        return _predict(self.arm, self.placement, self.tool, self.amounts, q, columns)


def _twists(joints: int, x: Array, count: int, columns: list[Motion]) -> Motion:
    constants = x[9 : 9 + 6 * joints].reshape(joints, 6)
    motions: list[Motion] = [{i + 1: np.tile(constants[i], (count, 1))} for i in range(joints)]
    return combine(np.concatenate([np.ones(joints), x[9 + 6 * joints :]]), motions + columns)


def _predict(arm: Arm, placement: Array, tool: Array, x: Array, q: Array, columns: list[Motion]) -> Array:
    at = placement @ small_motion(x[None, :6])[0]
    return points(arm, q, at, tool + x[6:9], _twists(len(arm.rows), x, len(q), columns))


def sensitivities(arm: Arm, placement: Array, tool: Array, q: Array, twists: Motion) -> Array:
    """(n + 1, N, 3, 6) motion of the measured point by a unit twist at each frame, the base first.

    G R_i [1, -[p_i]x], with R_i the frame and p_i the point in it.  A twist translates before it turns, so that this
    holds up to the size of the turn, a thousandth, which moves no minimum.
    """
    placed = frames(arm, q, twists)
    turns, origins = placed[..., :3, :3], placed[..., :3, 3]
    arms = np.einsum("nij,j->ni", turns[-1], tool) + origins[-1] - origins
    out = np.empty((*placed.shape[:2], 3, 6))
    out[..., :3] = placement[:3, :3] @ turns
    axes = turns.swapaxes(-1, -2)
    out[..., 3:] = placement[:3, :3] @ np.cross(axes, arms[:, :, None, :]).swapaxes(-1, -2)
    return out


def jacobian(arm: Arm, placement: Array, tool: Array, x: Array, q: Array, columns: list[Motion]) -> Array:
    """(3 N, 9 + 6 n + columns) derivatives of the points by the unknowns x."""
    at, twists = placement @ small_motion(x[None, :6])[0], _twists(len(arm.rows), x, len(q), columns)
    twists.pop(INSTRUMENT, None)
    by_twist = sensitivities(arm, at, tool + x[6:9], q, twists)
    by_tool = by_twist[-1, :, :, :3]
    blocks = [by_twist[0], by_tool, *by_twist[1:]]
    effects = [sum(_moved(by_twist, slot, twist) for slot, twist in column.items()) for column in columns]
    return np.concatenate([*blocks, *(e[:, :, None] for e in effects)], axis=2).reshape(3 * len(q), -1)


def _moved(by_twist: Array, slot: int, twist: Array) -> Array:
    return twist[:, :3] if slot == INSTRUMENT else np.einsum("nij,nj->ni", by_twist[slot], twist)


def decomposed(matrix: Array, cut: float = CUT) -> tuple[Array, Array, Array, Array]:
    """U, s and V of the unit-length columns without the singular values below cut times the largest, and the lengths,
    infinite where a column is nothing."""
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale < 1e-9 * scale.max()] = np.inf
    u, s, v = np.linalg.svd(matrix / scale, full_matrices=False)
    keep = s > cut * s[0]
    return u[:, keep], s[keep], v[keep], scale


def truncated(matrix: Array, right: Array, cut: float = CUT) -> Array:
    """Least squares of unit-length columns without the singular values below cut times the largest."""
    u, s, v, scale = decomposed(matrix, cut)
    return np.asarray(v.T @ ((u.T @ right) / s) / scale)


def fit(
    arm: Arm, q: Array, measured: Array, columns: list[Motion], start: tuple[Array, Array], cut: float = CUT
) -> Fit:
    """Gauss-Newton from a registration and tool, all unknowns together."""
    placement, tool = start
    x = np.zeros(9 + 6 * len(arm.rows) + len(columns))
    for _ in range(3):
        matrix = jacobian(arm, placement, tool, x, q, columns)
        x = x + truncated(matrix, (measured - _predict(arm, placement, tool, x, q, columns)).ravel(), cut)
    return Fit(arm, placement, tool, x)


def left_by(arm: Arm, q: Array, placement: Array, tool: Array, column: Motion) -> float:
    """3-D rms, in metres, of the part of an effect of unit amount that the standard model cannot take up."""
    matrix = jacobian(arm, placement, tool, np.zeros(10 + 6 * len(arm.rows)), q, [column])
    rest = matrix[:, -1] - matrix[:, :-1] @ truncated(matrix[:, :-1], matrix[:, -1])
    return float(np.sqrt(rest @ rest / len(q)))


def rms_mm(error: Array) -> float:
    """Root mean square of the 3-D distance, metres in, millimetres out."""
    return float(1e3 * np.sqrt(np.mean(np.sum(error**2, axis=1))))
