"""Cramér-Rao bound of the tool over the workspace for given readings, by finite differences.

C = (JᵀJ + P)⁻¹ of readings in standard deviations; the tool's deviation is that of G C Gᵀ less a motion of the whole.
P is what the errors of the description are drawn with, so that lengths which touches leave open have a bound too; where
the readings say everything it lowers the bound by a fiftieth. The form of an effect is told, size and phase are not.
Source: Van Trees (1968), Detection, Estimation, and Modulation Theory I, ch. 2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from experiments.blind.simulator import Array
from experiments.instruments.measuring import Session, frame
from experiments.instruments.reaching import ends
from experiments.instruments.robots import GEOMETRY, Robot

STEP, UNSEEN = 1e-6, 1e-6
"""Step of a difference, m or rad, and singular value of unit columns below which nothing is observable."""


def tool_points(robots: tuple[Robot, ...], made: Session, q: Array, arm: Array) -> Array:
    """Where the tool, or the camera or board it holds, really is on the floor (N, 3) at joint values q (N, all)."""
    x = _truth(robots, made)
    last, tools = _frames(robots, q, arm)(x)
    return ends(last, _held(made, x, tools))


def bound(robots: tuple[Robot, ...], made: Session, q: Array, arm: Array) -> float:
    """RMS deviation, m, of the tool at joint values q (N, all) of arms (N,), at least."""
    start = _truth(robots, made)
    there, fresh = _frames(robots, made.q, made.arm), _frames(robots, q, arm)
    own = len(start) - len(made.own)

    def readings(x: Array) -> Array:
        last, tools = there(x)
        return np.asarray(made.read(last, tools, x[own:]).ravel())

    def points(x: Array) -> Array:
        last, tools = fresh(x)
        return np.asarray(ends(last, _held(made, x, tools)).ravel())

    moved = _slopes(points, start)
    columns = np.vstack([_slopes(readings, start), np.diag(_described(robots, made))])
    size = np.linalg.norm(columns, axis=0)
    size[size < UNSEEN * size.max()] = np.inf
    _, s, v = np.linalg.svd(columns / size, full_matrices=False)
    seen = s > UNSEEN * s[0]
    spread = _still(moved, points(start).reshape(-1, 3)) @ ((v[seen].T / s[seen]) / size[:, None])
    return float(np.sqrt(np.sum(spread**2) / len(q)))


def _truth(robots: tuple[Robot, ...], made: Session) -> Array:
    """Base, errors, tool and effect of every robot, then the instrument's own."""
    each = []
    for r in robots:
        each += [r.base, r.errors.ravel(), r.tool, np.zeros(_constants(r, made))]
    return np.concatenate([*each, made.own])


def _described(robots: tuple[Robot, ...], made: Session) -> Array:
    """One over the standard deviation that each unknown is drawn with; zero of what nobody describes."""
    drawn = [
        np.concatenate([np.full(6 + r.errors.size, 1.0 / GEOMETRY), np.zeros(3 + _constants(r, made))]) for r in robots
    ]
    return np.concatenate([*drawn, np.zeros(len(made.own))])


def _constants(robot: Robot, made: Session) -> int:
    """Unknowns of its effect."""
    return len(robot.columns(made.q[:1, : len(robot.arm.rows)]))


def _frames(robots: tuple[Robot, ...], q: Array, arm: Array) -> Callable[[Array], tuple[Array, Array]]:
    """Unknowns to the last frame (N, 4, 4) and the tool (N, 3) of the arm in use. The effect is linear in its shares
    about what it truly is."""
    parts, first = [], 0
    for k, r in enumerate(robots):
        n, rows = len(r.arm.rows), np.flatnonzero(arm == k)
        mine = q[rows][:, first : first + n]
        first += n
        parts.append((r, rows, mine, r.true(mine), r.columns(mine)))

    def placed(x: Array) -> tuple[Array, Array]:
        last, tools, i = np.empty((len(q), 4, 4)), np.empty((len(q), 3)), 0
        for r, rows, mine, true, columns in parts:
            base, errors, tool, shares, rest = np.split(x[i:], np.cumsum([6, r.errors.size, 3, len(columns)]))
            i = len(x) - len(rest)
            amounts = np.concatenate([np.full(len(true), r.amount), shares])
            last[rows] = r.moved(mine, errors.reshape(-1, 6), base, true + columns, amounts)
            tools[rows] = tool
        return last, tools

    return placed


def _held(made: Session, x: Array, tools: Array) -> Array:
    """Return the tracked point at the tool: its point, or the origin of the camera or board that it holds."""
    return np.tile(frame(x[-6:])[:3, 3], (len(tools), 1)) if "camera" in made.kind else tools


def _slopes(of: Callable[[Array], Array], at: Array) -> Array:
    step = STEP * np.eye(len(at))
    return np.column_stack([(of(at + d) - of(at - d)) / (2 * STEP) for d in step])


def _still(moved: Array, points: Array) -> Array:
    """Columns (3 N, P) without the motion of all points (N, 3) together."""
    p = points - points.mean(axis=0)
    turns = np.concatenate([np.cross(e, p).reshape(-1, 1) for e in np.eye(3)], axis=1)
    basis = np.linalg.qr(np.hstack([np.tile(np.eye(3), (len(p), 1)), turns]))[0]
    return np.asarray(moved - basis @ (basis.T @ moved))
