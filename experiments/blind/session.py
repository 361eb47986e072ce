"""Simulate a measurement session: poses and their order, further columns, noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from experiments.blind.case import Case
from experiments.blind.instrument import along_azimuth, polar
from experiments.blind.simulator import Arm, Array, above_floor, draw_poses

UNITS = {"temperature": "degC", "payload": "kg", "time": "min", "pressure": "bar", "humidity": "1", "operator": "1"}
ENCODER_JITTER = 1e-5
CLUSTER_HALF_WIDTH = 0.02
LONGEST_MOVE = 0.2
TORQUE_NOISE = 0.01


@dataclass(frozen=True)
class Route:
    """Joint values (N, n) in the order of measurement, and which rows share a pose or a cluster (N,)."""

    q: Array
    pose: Array


def region(case: Case, arm: Arm, centre: Array, beyond: bool) -> Arm:
    """The arm with the limits that a case measures in; beyond: the rest of the joint that was trained in part."""
    limits = arm.limits.copy()
    if case.narrow < 1.0:
        half = 0.5 * case.narrow * (limits[:, 1] - limits[:, 0])
        limits = np.column_stack([centre - half, centre + half])
    for joint in range(1, len(limits) + 1):
        if case.moving and joint not in case.moving:
            limits[joint - 1] = centre[joint - 1]
    if case.trained:
        joint, low, high = case.trained
        start, end = arm.limits[joint - 1]
        edges = start + (end - start) * np.array([low, high, 1.0])
        limits[joint - 1] = edges[1:] if beyond else edges[:2]
    return replace(arm, limits=limits)


def route(case: Case, arm: Arm, count: int, rng: np.random.Generator) -> Route:
    """`count` rows within the arm's limits: independent poses, a walk, clusters, or repeats in rounds."""
    if case.order == "walk":
        return Route(_rounded(arm, _walk(arm, count, rng)), np.arange(count))
    if case.order == "clusters":
        centres = draw_poses(arm, max(count // 10, 1), rng)
        pose = np.arange(count) * len(centres) // count
        spread = CLUSTER_HALF_WIDTH * (arm.limits[:, 1] - arm.limits[:, 0])
        q = centres[pose] + spread * rng.uniform(-1, 1, (count, len(arm.rows)))
        return Route(_rounded(arm, np.clip(q, arm.limits[:, 0], arm.limits[:, 1])), pose)
    distinct = draw_poses(arm, count // case.repeats, rng)
    pose = np.tile(np.arange(len(distinct)), case.repeats)
    q = distinct[pose]
    if case.repeats > 1 and not case.labelled:
        q = q + ENCODER_JITTER * rng.normal(size=q.shape)
    return Route(_rounded(arm, q), pose)


def _walk(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """Moves of every joint up to a fifth of its range, reflected at the limits; rows under the floor left out."""
    low, width = arm.limits[:, 0], arm.limits[:, 1] - arm.limits[:, 0]
    kept = np.empty((0, len(low)))
    while len(kept) < count:
        steps = rng.uniform(-LONGEST_MOVE, LONGEST_MOVE, (2 * count, len(low)))
        steps[0] += rng.uniform(0, 2, len(low))
        folded = 1.0 - np.abs(np.mod(np.cumsum(steps, axis=0), 2.0) - 1.0)
        q = low + width * folded
        kept = np.vstack([kept, q[above_floor(arm, q)]])
    return kept[:count]


def _rounded(arm: Arm, q: Array) -> Array:
    """Round as the table does: 1e-4 degrees or millimetres."""
    slides = np.array([joint + 1 in arm.prismatic for joint in range(len(arm.rows))])
    turned = np.radians(np.round(np.degrees(q), 4))
    return np.where(slides, 1e-3 * np.round(1e3 * q, 4), turned)


def extra_columns(case: Case, row: Array, count: int, rng: np.random.Generator) -> dict[str, Array]:
    """The columns of a table of `count` rows, but for the torques; `room` is a temperature that changes slowly."""
    extra: dict[str, Array] = {}
    for name in case.columns:
        if name == "room":
            extra["temperature"] = _room(extra["time"], rng)
        elif not name.startswith("torque_"):
            extra[name] = _extra(case, name, row, count, rng)
    return extra


def _extra(case: Case, name: str, row: Array, count: int, rng: np.random.Generator) -> Array:
    if name == "temperature":
        return np.round(24.0 + 5.0 * np.sin(2 * np.pi * (1.3 * row + rng.uniform())) + rng.normal(0, 0.7, count), 2)
    if name == "payload":
        return np.asarray(rng.choice([0.0, 2.0, 5.0, 10.0], count))
    if name == "time":
        return np.sort(np.round(case.minutes * row + rng.uniform(-0.4, 0.4, count), 2))
    if name == "humidity":
        return np.round(0.45 + 0.1 * row + rng.normal(0, 0.03, count), 3)
    if name == "operator":
        return np.asarray(rng.integers(1, 4, count), dtype=float)
    return np.asarray(rng.choice([-1.0, 1.0], count))


def _room(time: Array, rng: np.random.Generator) -> Array:
    """Degrees over minutes: two slow waves, a door that opens once, a sensor of 0.05 K."""
    out = np.full(len(time), 22.0)
    for period in (rng.uniform(150, 300), rng.uniform(50, 100)):
        out += rng.uniform(1.5, 3.0) * np.sin(2 * np.pi * (time / period + rng.uniform()))
    out -= 3.0 * (time > time[0] + rng.uniform(0.3, 0.7) * np.ptp(time))
    return np.round(out + rng.normal(0, 0.05, len(time)), 2)


def measured_torque(torque: Array, rng: np.random.Generator) -> Array:
    """Return the torque that the controller reports: it holds the joint against gravity, with noise of 1 % of its
    rms.
    """
    return np.round(-torque + TORQUE_NOISE * np.sqrt(np.mean(torque**2)) * rng.normal(size=len(torque)), 3)


def noise(case: Case, clean: Array, rng: np.random.Generator) -> Array:
    """(N, 3) independent from row to row, m: Gaussian, growing with the distance, or of Student's t with 3 degrees."""
    spread = np.full(len(clean), case.noise_mm)
    if case.noise == "distance":
        distance = np.linalg.norm(clean, axis=1)
        spread = spread * distance / distance.mean()
    draws = rng.normal(size=clean.shape)
    if case.noise == "student":
        draws /= np.sqrt(rng.chisquare(3, size=clean.shape))
    return 1e-3 * spread[:, None] * draws


def shared_noise(case: Case, pose: Array, rng: np.random.Generator) -> Array:
    """(N, 3) the same for all rows of a pose or cluster, m."""
    return 1e-3 * case.shared_mm * rng.normal(size=(int(pose.max()) + 1, 3))[pose]


def walk_noise(case: Case, clean: Array, rng: np.random.Generator) -> Array:
    """(N, 3) random walk of the instrument, m: it shifts and turns about its standing axis, over the session as a whole
    by nothing, its 3-D rms the stated one."""
    angle = np.cumsum(rng.normal(size=len(clean))) / polar(clean)[0].mean()
    turned = along_azimuth(clean, angle - angle.mean())
    moved = np.cumsum(rng.normal(size=clean.shape), axis=0) + turned
    moved -= moved.mean(axis=0)
    return np.asarray(1e-3 * case.walk_mm * moved / np.sqrt(np.mean(np.sum(moved**2, axis=1))))
