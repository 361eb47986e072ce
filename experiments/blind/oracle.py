"""Least squares told everything but the numbers: registration, tool, six small motions a joint, the effects' forms.

Unknowns: rotation and translation of the registration (6), tool point (3), a constant small motion of the frame of
every joint (6 n), one amount for every column of the effects.  Gauss-Newton with central differences; the columns are
scaled to unit length and the singular values below `CUT` times the largest are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from experiments.blind.effects import Motion, combine
from experiments.blind.simulator import Arm, Array, frames, points, small_motion

CUT = 2e-3
STEP = 1e-6


def register(arm: Arm, q: Array, measured: Array) -> tuple[Array, Array]:
    """Placement (4, 4) and tool (3,) of the nominal arm: best rigid motion of the flange, then both together."""
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
        return ((flange[:, :3, :3] @ x[6:] + origin) @ at[:3, :3].T + at[:3, 3] - measured).ravel()

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


def _predict(arm: Arm, placement: Array, tool: Array, x: Array, q: Array, columns: list[Motion]) -> Array:
    joints = len(arm.rows)
    constants = x[9 : 9 + 6 * joints].reshape(joints, 6)
    motions: list[Motion] = [{i + 1: np.tile(constants[i], (len(q), 1))} for i in range(joints)]
    twists = combine(np.concatenate([np.ones(joints), x[9 + 6 * joints :]]), motions + columns)
    at = placement @ small_motion(x[None, :6])[0]
    return points(arm, q, at, tool + x[6:9], twists)


def jacobian(model: Callable[[Array], Array], x: Array, steps: Array) -> Array:
    out = []
    for i in range(len(x)):
        shift = np.zeros_like(x)
        shift[i] = steps[i]
        out.append((model(x + shift) - model(x - shift)).ravel() / (2 * steps[i]))
    return np.array(out).T


def truncated(matrix: Array, right: Array, cut: float = CUT) -> Array:
    """Least squares of unit-length columns without the singular values below cut times the largest."""
    scale = np.linalg.norm(matrix, axis=0)
    scale[scale < 1e-9 * scale.max()] = np.inf
    u, s, v = np.linalg.svd(matrix / scale, full_matrices=False)
    keep = s > cut * s[0]
    return np.asarray(v[keep].T @ ((u[:, keep].T @ right) / s[keep]) / scale)


def _steps(joints: int, columns: list[Motion]) -> Array:
    """Differences of about a micrometre or a microradian in every unknown."""
    sizes = [max(np.abs(t).max() for t in c.values()) for c in columns]
    return np.concatenate([np.full(9 + 6 * joints, STEP), STEP / np.maximum(sizes, 1e-12)])


def fit(
    arm: Arm, q: Array, measured: Array, columns: list[Motion], start: tuple[Array, Array], cut: float = CUT
) -> Fit:
    """Gauss-Newton from a registration and tool, all unknowns together."""
    placement, tool = start
    joints = len(arm.rows)
    x = np.zeros(9 + 6 * joints + len(columns))

    def model(amounts: Array) -> Array:
        return _predict(arm, placement, tool, amounts, q, columns)

    matrix = jacobian(model, x, _steps(joints, columns))
    for _ in range(3):
        x = x + truncated(matrix, (measured - model(x)).ravel(), cut)
        matrix = jacobian(model, x, _steps(joints, columns))
    return Fit(arm, placement, tool, x)


def left_by(arm: Arm, q: Array, placement: Array, tool: Array, column: Motion) -> float:
    """3-D rms, in metres, of the part of an effect of unit amount that the standard model cannot take up."""
    x = np.zeros(9 + 6 * len(arm.rows) + 1)

    def model(amounts: Array) -> Array:
        return _predict(arm, placement, tool, amounts, q, [column])

    matrix = jacobian(model, x, _steps(len(arm.rows), [column]))
    rest = matrix[:, -1] - matrix[:, :-1] @ truncated(matrix[:, :-1], matrix[:, -1])
    return float(np.sqrt(rest @ rest / len(q)))


def rms_mm(error: Array) -> float:
    """Root mean square of the 3-D distance, metres in, millimetres out."""
    return float(1e3 * np.sqrt(np.mean(np.sum(error**2, axis=1))))
