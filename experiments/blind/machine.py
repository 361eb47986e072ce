"""Simulate a machine: arm with errors, registration, measured targets."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from experiments.blind.case import Case
from experiments.blind.effects import draw
from experiments.blind.robot import Sheet, world_of
from experiments.blind.session import Route, extra_columns, measured_torque, noise, region, route, shared_noise
from experiments.blind.shapes import Motion, Shape, World, combine
from experiments.blind.simulator import Arm, Array, draw_poses, points, small_motion


@dataclass(frozen=True)
class Machine:
    """arm: with the masses it has; errors: (n, 6) m, rad at the joints; centre: (n,) of a part of the workspace."""

    case: Case
    arm: Arm
    errors: Array
    tool: Array
    placement: Array
    shapes: list[Shape]
    centre: Array

    def drawn(self, count: int, rng: np.random.Generator, beyond: bool = False) -> tuple[Route, World]:
        """Poses in their order, and all that they depend on."""
        chosen = route(self.case, region(self.case, self.arm, self.centre, beyond), count, rng)
        return chosen, self.world_at(chosen, rng)

    def world_at(self, chosen: Route, rng: np.random.Generator) -> World:
        """All that poses depend on, in their order."""
        row = np.arange(len(chosen.q)) / max(self.case.poses - 1, 1)
        extra = extra_columns(self.case, row, len(chosen.q), rng)
        world = world_of(self.arm, chosen.q, extra, row, self.tool, self.placement)
        for name in self.case.columns:
            if name.startswith("torque_J"):
                extra[name] = measured_torque(world.torque(int(name[8:])), rng)
        return replace(world, start=self.arm.middle)

    def measured(self, amounts: list[float], chosen: Route, world: World, rng: np.random.Generator) -> Sheet:
        """Where the poses are, and what the instrument says of them, with the case's outliers and no walk."""
        count, joints = len(world.q), len(self.errors)
        constants: list[Motion] = [{i + 1: np.tile(self.errors[i], (count, 1))} for i in range(joints)]
        motions = constants + [shape.true(world) for shape in self.shapes]
        twists = combine(np.array([1.0] * joints + amounts), motions)
        clean = points(self.arm, world.q, self.placement, self.tool, twists)
        read = clean + noise(self.case, clean, rng)
        wrong = rng.permutation(count)[: round(self.case.outliers * count)]
        jump = rng.normal(size=(len(wrong), 3))
        jump *= 1e-3 * rng.uniform(0.6, 3.0, (len(wrong), 1)) / np.linalg.norm(jump, axis=1, keepdims=True)
        read[wrong] += jump
        if self.case.shared_mm:
            read += shared_noise(self.case, chosen.pose, rng)
        return Sheet(world.q, dict(world.extra), world.row, clean, read, np.sort(wrong), chosen.pose)

    def under(self, **changes: object) -> Machine:
        """Return the machine measured under other conditions."""
        return replace(self, case=replace(self.case, **changes))


def stand(case: Case, described: Arm, rng: np.random.Generator) -> Machine:
    """Draw a machine: six errors of 0.1-1 mm and 0.2-1 mrad a joint, a tool, a place in the tracker, the effects."""
    joints = len(described.rows)
    arm = described.heavier(1.0 + rng.uniform(-1, 1, joints) * case.masses_off)
    size = rng.uniform([[0.1e-3] * 3 + [0.2e-3] * 3] * joints, [[1e-3] * 6] * joints)
    errors = size * rng.choice([-1.0, 1.0], size.shape)
    tool = rng.normal(size=3)
    tool *= rng.uniform(0.05, 0.3) / np.linalg.norm(tool)
    placement = _levelled(rng) if case.tracker == "levelled" else _anywhere(rng)
    shapes = [
        draw(kind, described, rng, **{k: v for k, v in settings.items() if k != "amount"})
        for kind, settings, _ in case.effects
    ]
    if case.masses == "wrong":
        arm = arm.heavier(_reweighed(case, joints, rng))
    part = case.narrow < 1.0 or case.moving
    return Machine(case, arm, errors, tool, placement, shapes, _centre(arm, rng) if part else arm.middle)


def _anywhere(rng: np.random.Generator) -> Array:
    """(4, 4) within 3 m, in any orientation."""
    return small_motion(np.concatenate([rng.uniform(-3, 3, 3), rng.normal(size=3) * 1.5])[None])[0]


def _levelled(rng: np.random.Generator) -> Array:
    """(4, 4) of a base 2.5 to 4 m from a tracker that stands upright within three degrees."""
    side, distance = rng.uniform(-np.pi, np.pi), rng.uniform(2.5, 4.0)
    away = [distance * np.cos(side), distance * np.sin(side), rng.uniform(-1.5, 0.0)]
    turned = small_motion(np.array([[0, 0, 0, 0, 0, rng.uniform(-np.pi, np.pi)]]))[0]
    tilted = small_motion(np.concatenate([away, np.radians(rng.uniform(-3, 3, 2)), [0.0]])[None])[0]
    return tilted @ turned


def _reweighed(case: Case, joints: int, rng: np.random.Generator) -> Array:
    """(n,) factors: the links in `wrong` are 30 to 50 % off, to either side."""
    factors = np.ones(joints)
    off = rng.uniform(0.3, 0.5, len(case.wrong)) * rng.choice([-1.0, 1.0], len(case.wrong))
    factors[np.array(case.wrong) - 1] += off
    return factors


def _centre(arm: Arm, rng: np.random.Generator) -> Array:
    """(n,) a pose in the middle half of every joint's range."""
    quarter = 0.25 * (arm.limits[:, 1] - arm.limits[:, 0])
    inner = replace(arm, limits=np.column_stack([arm.middle - quarter, arm.middle + quarter]))
    return np.asarray(draw_poses(inner, 1, rng)[0])
