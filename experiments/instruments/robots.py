"""Simulate robots with one undeclared effect or none by plain 4x4 products, without code of gpmodel.

A machine is one arm, or two arms side by side on one floor; the undeclared effect is in the first arm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from experiments.blind.arms import ARMS
from experiments.blind.effects import draw
from experiments.blind.files import urdf
from experiments.blind.oracle import left_by
from experiments.blind.shapes import Motion, Shape, World, combine
from experiments.blind.simulator import Arm, Array, draw_poses, frames, gravity_loads, small_motion

SIX = ("ur_like", "puma_like", "staubli_like", "irb_like", "kuka_like", "cobot_ten", "welder")
UNDECLARED = ("compliance", "harmonic", "gravity_backlash")
CALLED = dict(zip(UNDECLARED, ("joint compliance", "eccentricity", "backlash by load"), strict=True))
"""Names in the catalogue."""
GEOMETRY, SIZE, TOOL, APART = 3e-4, 4e-4, 0.15, 0.8
"""m and rad of every constant error; m RMS at the tool that the effect leaves of a geometric fit; m of the tool; of
their lengths, how far two arms are apart."""
BOTH_SIDES = 0.15
"""Share of the poses, at least, in which gravity pushes a joint with play to its rarer side."""


@dataclass(frozen=True)
class Robot:
    """errors: (n, 6) m, rad in the frames of the joints. tool: (3,) m. stands: (4, 4) on the floor, and by `base`
    (6,) off it."""

    arm: Arm
    errors: Array
    tool: Array
    stands: Array
    base: Array
    shape: Shape | None = None
    kind: str = ""
    joint: int = 0
    amount: float = 0.0

    def columns(self, q: Array) -> list[Motion]:
        """Return the columns of the undeclared effect per unit of its unknowns: known form, unknown size and phase."""
        return [] if self.shape is None else self.shape.basis(self._world(q))

    def true(self, q: Array) -> list[Motion]:
        """Return the columns of the true effect per unit of `amount`; empty for a robot without one."""
        return [] if self.shape is None else [self.shape.true(self._world(q))]

    def last(self, q: Array) -> Array:
        """Its last frame as it really is (N, 4, 4), on the floor."""
        true = self.true(q)
        return self.moved(q, self.errors, self.base, true, np.full(len(true), self.amount))

    def moved(self, q: Array, errors: Array, base: Array, columns: list[Motion], shares: Array) -> Array:
        """Return the frames with errors (n, 6), a motion (6,) of the base, and shares of an effect's columns."""
        constant: list[Motion] = [{i: np.tile(e, (len(q), 1))} for i, e in enumerate([base, *errors])]
        twists = combine(np.concatenate([np.ones(len(constant)), shares]), constant + columns)
        return np.asarray(self.stands @ frames(self.arm, q, twists)[-1])

    def tools(self, rows: Array) -> Array:
        """Its tool (N, 3) as often as there are rows."""
        return np.tile(self.tool, (len(rows), 1))

    def _world(self, q: Array) -> World:
        return World(self.arm, q, {}, np.zeros(len(q)), gravity_loads(self.arm, q), self.tool, np.zeros((len(q), 3)))


def machine(seed: int, guilty: bool, arms: int = 1) -> tuple[Robot, ...]:
    """One robot, or two beside one another, the first perhaps guilty."""
    rng = np.random.default_rng([seed, arms])
    first = _robot(ARMS[SIX[seed % len(SIX)]], np.eye(4), np.zeros(6), rng)
    out = [_with_effect(first, UNDECLARED[seed % len(UNDECLARED)], rng) if guilty else first]
    if arms > 1:
        apart = APART * np.abs(first.arm.rows[1:, 1:3]).sum()
        at = small_motion(np.array([[apart, 0, 0, 0, 0, np.pi]]))[0]
        out.append(_robot(first.arm, at, rng.normal(0.0, GEOMETRY, 6), rng))
    return tuple(out)


def _robot(arm: Arm, stands: Array, base: Array, rng: np.random.Generator) -> Robot:
    tool, errors = rng.normal(size=3), rng.normal(0.0, GEOMETRY, (len(arm.rows), 6))
    return Robot(arm, errors, TOOL * tool / np.linalg.norm(tool), stands, base)


def _with_effect(robot: Robot, kind: str, rng: np.random.Generator) -> Robot:
    q = draw_poses(robot.arm, 200, rng)
    joint = int(rng.choice(_yielding(robot.arm, q, kind)))
    shape = draw(kind, robot.arm, rng, joint=joint, **({"per_turn": 1.0} if kind == "harmonic" else {}))
    whole = replace(robot, shape=shape, kind=kind, joint=joint)
    return replace(whole, amount=SIZE / left_by(robot.arm, q, np.eye(4), robot.tool, whole.true(q)[0]))


def _yielding(arm: Arm, q: Array, kind: str) -> list[int]:
    """Joints, from 1, in which an effect of a kind shows: under load; loaded to both sides; any of the first four."""
    torque = gravity_loads(arm, q).torque
    size = np.sqrt(np.mean(torque**2, axis=0))
    loaded = [j for j in (2, 3, 4, 5) if size[j - 1] > 0.05 * size.max()]
    if kind == "gravity_backlash":
        rarer = np.minimum((torque > 0).mean(axis=0), (torque < 0).mean(axis=0))
        return [j for j in loaded if rarer[j - 1] > BOTH_SIDES] or [int(np.argmax(rarer)) + 1]
    return loaded[:2] if kind == "compliance" else [1, 2, 3, 4]


def description(robots: tuple[Robot, ...]) -> str:
    """URDF of the machine as it should be; the joints of a second arm are R1, R2, ..., its links right_1, ..."""
    text = urdf(robots[0].arm)
    if len(robots) > 1:
        right = urdf(robots[1].arm).split('<link name="base"/>')[1].replace("</robot>", "")
        right = right.replace('"base"', '"right_base"').replace('"link_', '"right_').replace('name="J', 'name="R')
        x, y, _, _ = robots[1].stands[:, 3]
        stand = (
            '<link name="right_base"/><joint name="stand" type="fixed"><parent link="base"/><child link="right_base"/>'
            f'<origin xyz="{x:.12g} {y:.12g} 0" rpy="0 0 {np.pi:.15g}"/></joint>'
        )
        text = text.replace("</robot>", f"{stand}{right}</robot>")
    return text


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
