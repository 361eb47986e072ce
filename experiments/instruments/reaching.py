"""Joint values at which a real tool is where it should be."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from experiments.blind.simulator import Array, draw_poses, frames
from experiments.instruments.robots import Robot

POOL, STEPS, REDRAWN, NEAREST = 6000, 60, 40, 40
"""Random poses to start from; steps from one; starts; of which the nearest are drawn from."""
Aim = Callable[[Array], Array]
"""Where tool points (N, 3) should be, m."""


class Unreached(RuntimeError):
    """Some poses do not get where they should be."""


def ends(last: Array, tools: Array) -> Array:
    """Tool points (N, 3) of last frames (N, 4, 4) and points in them (N, 3)."""
    return np.asarray(np.einsum("nij,nj->ni", last[:, :3, :3], tools) + last[:, :3, 3])


def reached(robots: tuple[Robot, ...], arm: Array, aim: Aim, rng: np.random.Generator) -> Array:
    """Joint values (N, all) at which the real tool of the arm in use is where it should be; the others stand at
    random."""
    q = [draw_poses(r.arm, len(arm), rng) for r in robots]
    for k, robot in enumerate(robots):
        mine = np.flatnonzero(arm == k)
        q[k][mine] = _arrived(robot, len(arm), mine, aim, rng)
    return np.hstack(q)


def _arrived(robot: Robot, count: int, mine: Array, aim: Aim, rng: np.random.Generator) -> Array:
    """Joint values of one arm at some of the poses, by damped Newton steps from one of the nearest of many random
    poses, another one where these do not arrive."""
    spare = draw_poses(robot.arm, POOL, rng)
    known = ends(robot.last(spare), robot.tools(spare))
    q, full, left = np.zeros((count, spare.shape[1])), np.zeros((count, 3)), mine
    full[left] = known[rng.choice(POOL, len(left))]
    for _ in range(REDRAWN):
        near = np.argsort(np.linalg.norm(known[None] - aim(full)[left, None], axis=2), axis=1)[:, :NEAREST]
        start = spare[near[np.arange(len(left)), rng.integers(NEAREST, size=len(left))]]
        q[left], full[left], off = _newton(robot, start, partial(_aimed, aim, full, left))
        left = left[off]
        if not len(left):
            return q[mine]
    raise Unreached(f"{len(left)} of {count} poses are not reached")


def _aimed(aim: Aim, full: Array, rows: Array, p: Array) -> Array:
    """Where the tool points (n, 3) of some rows should be."""
    whole = full.copy()
    whole[rows] = p
    return np.asarray(aim(whole)[rows])


def _newton(robot: Robot, q: Array, aim: Aim) -> tuple[Array, Array, Array]:
    q, low, high = q.copy(), *robot.arm.limits.T
    for _ in range(STEPS):
        last = robot.last(q)
        p = ends(last, robot.tools(last))
        miss = aim(p) - p
        off = np.linalg.norm(miss, axis=1) > 1e-9
        if not off.any():
            break
        reach = _reach(robot, q, p)
        gram = reach @ reach.swapaxes(1, 2) + 1e-9 * np.eye(3)
        move = np.einsum("nij,ni->nj", reach, np.linalg.solve(gram, miss[:, :, None])[:, :, 0])
        move *= np.minimum(1.0, 0.2 / np.maximum(np.abs(move).max(axis=1, keepdims=True), 1e-12))
        q = np.where(off[:, None], np.clip(q + move, low, high), q)
    return q, p, off


def _reach(robot: Robot, q: Array, p: Array) -> Array:
    """Motion (N, 3, n) of the tool by every joint: its axis times the lever, of the arm as described."""
    placed = robot.stands @ frames(robot.arm, q)[1:]
    return np.stack([np.cross(f[:, :3, 2], p - f[:, :3, 3]) for f in placed], axis=2)
