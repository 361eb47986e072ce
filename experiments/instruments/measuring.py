"""Simulate readings: pixels by a pinhole model, touches by the joint values that reach them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from experiments.blind.simulator import Array, draw_poses, small_motion
from experiments.instruments.robots import Robot, Unreached, ends, reached

FOCAL, IMAGE, PIXEL = 2400.0, (2448.0, 2048.0), 0.1
LENGTH = 3e-5
"""px and m, standard deviations of a pixel's coordinate, of a tracker's and of a contact."""
BALL, BAR, PITCH = 0.025, 0.3, 0.02
BOARD = PITCH * np.array([[i, j, 0.0] for j in range(4) for i in range(5)])
STEEPEST = np.cos(np.radians(55.0))
POOL = 6000


@dataclass(frozen=True)
class Session:
    """q: (N, all joints) of every pose, and which arm (N,) is measured there. own: true numbers of what the instrument
    looks at, in the order that `read` takes them in. read: the last frame of the arm in use (N, 4, 4) on the floor, its
    tools (N, 3) and `own` to what would be read (N, m), in standard deviations. noisy: the same as measured.
    columns: of the table beside the joints. described: TOML files beside the table, as dictionaries."""

    kind: str
    q: Array
    arm: Array
    own: Array
    read: Callable[[Array, Array, Array], Array]
    noisy: Array
    columns: dict[str, Array]
    described: dict[str, dict[str, object]] = field(default_factory=dict)


def frame(numbers: Array) -> Array:
    """(4, 4) of three metres and a rotation vector."""
    return np.asarray(small_motion(numbers[None])[0])


def session(kind: str, robots: tuple[Robot, ...], count: int, rng: np.random.Generator) -> Session:
    """`count` poses measured by an instrument."""
    return KINDS[kind](robots, count, rng)


def tracker(robots: tuple[Robot, ...], count: int, rng: np.random.Generator) -> Session:
    """Three coordinates a pose, in a frame of its own."""
    q = draw_poses(robots[0].arm, count, rng)
    own = np.concatenate([rng.uniform(-3, 3, 3), rng.normal(size=3)])

    def read(last: Array, tool: Array, own: Array) -> Array:
        at = frame(own)
        return np.asarray((ends(last, tool) @ at[:3, :3].T + at[:3, 3]) / LENGTH)

    noisy = _noisy(read(robots[0].last(q), robots[0].tools(q), own), rng)
    columns = {f"{axis} [mm]": 1e3 * LENGTH * v for axis, v in zip("xyz", noisy.T, strict=True)}
    return Session("tracker", q, np.zeros(count, int), own, read, noisy, columns)


def seen(robots: tuple[Robot, ...], count: int, rng: np.random.Generator, outside: bool) -> Session:
    """Twenty corners a pose: a camera in the world and a board at the tool, or the other way round."""
    robot = robots[0]
    pool = draw_poses(robot.arm, POOL, rng)
    last, hold = robot.last(pool), np.concatenate([robot.tool, rng.normal(0.0, 0.1, 3)])
    held = last @ frame(hold)
    middle = np.median(held[:, :3, 3], axis=0)
    distance = 0.3 + 1.5 * np.median(np.linalg.norm(held[:, :3, 3] - middle, axis=1))
    best: tuple[Array, Array] | None = None
    for z in held[rng.choice(POOL, 30, replace=False), :3, 2]:
        x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
        x /= np.linalg.norm(x)
        turn = np.column_stack([x, -np.cross(z, x), -z])
        stand = np.concatenate([middle + distance * z, _vector(turn)])
        good = np.flatnonzero(_in_sight(held, frame(stand), outside))
        if best is None or len(good) > len(best[1]):
            best = stand, good
    assert best is not None
    own, q = np.concatenate([best[0], hold]), pool[best[1][:count]]

    def read(last: Array, tool: Array, own: Array) -> Array:
        stands, held = frame(own[:6]), last @ frame(own[6:])
        camera, board = (np.broadcast_to(stands, held.shape), held) if outside else (held, stands)
        x = _corners(camera, board)
        u = FOCAL * x[..., :2] / x[..., 2:] + 0.5 * np.array(IMAGE)
        return np.asarray(u.reshape(len(last), -1) / PIXEL)

    noisy = _noisy(read(robot.last(q), robot.tools(q), own), rng)
    links = ("world", "tool") if outside else ("tool", "world")
    described = {
        "cameras": {"camera": {"C": {
            "link": links[0], "focal_px": [FOCAL, FOCAL], "centre_px": [0.5 * IMAGE[0], 0.5 * IMAGE[1]]}}},
        "board": {"board": {"B": {"link": links[1], "columns": 5, "rows": 4, "pitch_mm": 1e3 * PITCH}}},
    }  # fmt: skip
    name = "camera" if outside else "hand camera"
    return Session(name, q, np.zeros(len(q), int), own, read, noisy, {}, described)


def probe(robots: tuple[Robot, ...], count: int, rng: np.random.Generator) -> Session:
    """Three planes and three spheres of known diameter, touched in turn."""
    near = _nearby(robots[0], rng)
    what = np.arange(count) % 6
    turn = frame(np.concatenate([np.zeros(3), rng.normal(0.0, 0.3, 3)]))[:3, :3]
    centres = near[rng.choice(len(near), 3, replace=False)]
    normals = turn.T
    own = np.concatenate([*(np.append(n, n @ near[0]) for n in normals), *centres])

    def read(last: Array, tool: Array, own: Array) -> Array:
        p = ends(last, tool)
        planes, spheres = own[:12].reshape(3, 4), own[12:].reshape(3, 3)
        size = np.linalg.norm(planes[:, :3], axis=1)
        flat = (p @ planes[:, :3].T - planes[:, 3]) / size
        round_ = np.linalg.norm(p[:, None] - spheres, axis=2) - BALL
        return np.asarray(np.hstack([flat, round_])[np.arange(len(p)), np.arange(len(p)) % 6][:, None] / LENGTH)

    away = rng.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    slip = rng.normal(0.0, LENGTH, (count, 1))

    def aim(p: Array) -> Array:
        normal, centre = normals[what % 3], centres[what % 3]
        flat = p - (np.sum((p - near[0]) * normal, axis=1, keepdims=True) - slip) * normal
        return np.where(what[:, None] < 3, flat, centre + (BALL + slip) * away)

    q = reached(robots, np.zeros(count, int), aim, rng)
    names = np.array(["A", "B", "C"])[what % 3]
    columns = {"on_plane": np.where(what < 3, names, ""), "on_sphere": np.where(what >= 3, names, "")}
    balls = {"surfaces": {"sphere": {name: {"diameter_mm": 2e3 * BALL} for name in "ABC"}}}
    noisy = np.zeros((count, 1))
    return Session("planes and spheres", q, np.zeros(count, int), own, read, noisy, columns, balls)


def bars(robots: tuple[Robot, ...], count: int, rng: np.random.Generator) -> Session:
    """Both ends of a bar of known length, laid somewhere, touched one after the other."""
    near = _nearby(robots[0], rng, 0.5)
    first = near[rng.choice(len(near), count // 2)]
    apart = np.linalg.norm(near[None] - first[:, None], axis=2)
    along = near[np.argmin(np.abs(apart - BAR) + 0.3 * rng.random(apart.shape), axis=1)] - first
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    target = np.stack([first, first + BAR * along], axis=1).reshape(-1, 3) + rng.normal(0.0, LENGTH, (count, 3))

    def read(last: Array, tool: Array, own: Array) -> Array:
        p = ends(last, tool)
        return np.asarray((np.linalg.norm(p[1::2] - p[::2], axis=1) - BAR)[:, None] / (np.sqrt(2) * LENGTH))

    q = reached(robots, np.zeros(count, int), lambda p: target, rng)
    columns = {"pair": np.repeat([f"B{k}" for k in range(count // 2)], 2), "length [mm]": np.full(count, 1e3 * BAR)}
    return Session("bars", q, np.zeros(count, int), np.zeros(0), read, np.zeros((count // 2, 1)), columns)


def two_arms(robots: tuple[Robot, ...], count: int, rng: np.random.Generator) -> Session:
    """Points that both arms touch, twice each, in other poses."""
    reach = [_nearby(r, rng, 1.0) for r in robots]
    which, arm = np.arange(count) // 4, np.arange(count) % 2
    apart = np.max([_fifth(reach[0], arm_s) for arm_s in reach], axis=0)
    for widest in (max(100, count), 2 * (1 + count // 4), 1 + count // 4):
        points = reach[0][rng.choice(np.argsort(apart)[:widest], 1 + count // 4, replace=False)]
        target = points[which] + rng.normal(0.0, LENGTH, (count, 3))
        try:
            q = reached(robots, arm, partial(_fixed, target), rng)
            break
        except Unreached:
            continue
    else:
        raise Unreached("no points that both arms reach")

    def read(last: Array, tool: Array, own: Array) -> Array:
        return np.asarray((ends(last, tool) - own.reshape(-1, 3)[which[: len(last)]]) / LENGTH)

    columns = {"tip": np.array(["link_6", "right_6"])[arm], "same_point": np.array([f"P{k}" for k in which])}
    return Session("two arms", q, arm, points[: which[-1] + 1].ravel(), read, np.zeros((count, 3)), columns)


KINDS: dict[str, Callable[[tuple[Robot, ...], int, np.random.Generator], Session]] = {
    "tracker": tracker,
    "camera": lambda robots, count, rng: seen(robots, count, rng, True),
    "hand camera": lambda robots, count, rng: seen(robots, count, rng, False),
    "planes and spheres": probe,
    "bars": bars,
    "two arms": two_arms,
}


def _noisy(exact: Array, rng: np.random.Generator) -> Array:
    return np.asarray(exact + rng.normal(size=exact.shape))


def _corners(camera: Array, board: Array) -> Array:
    """Corners (N, C, 3) of boards in cameras, both (N, 4, 4)."""
    at = np.linalg.inv(camera) @ board
    return np.asarray(np.einsum("nij,cj->nci", at[:, :3, :3], BOARD) + at[:, None, :3, 3])


def _in_sight(held: Array, stands: Array, outside: bool) -> Array:
    """Return whether a camera sees all corners of the board, from its front and not too flat."""
    camera, board = (
        (np.broadcast_to(stands, held.shape), held) if outside else (held, np.broadcast_to(stands, held.shape))
    )
    x = _corners(camera, board)
    ahead = x[..., 2] > 0.1
    inside = (np.abs(FOCAL * x[..., :2] / np.where(ahead, x[..., 2], 1.0)[..., None]) < 0.5 * np.array(IMAGE)).all(2)
    facing = -(np.linalg.inv(camera) @ board)[:, 2, 2] > STEEPEST
    return np.asarray((ahead & inside).all(axis=1) & facing)


def _vector(turn: Array) -> Array:
    """Rotation vector (3,) of a matrix (3, 3)."""
    values, vectors = np.linalg.eig(turn)
    axis = np.real(vectors[:, np.argmin(np.abs(values - 1.0))])
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return np.asarray(axis * np.arctan2(0.5 * skew @ axis, 0.5 * (np.trace(turn) - 1.0)))


def _nearby(robot: Robot, rng: np.random.Generator, share: float = 0.25) -> Array:
    """Tool points (P, 3) of random poses, those nearest to their middle."""
    last = robot.last(draw_poses(robot.arm, 2000, rng))
    p = ends(last, robot.tools(last))
    off = np.linalg.norm(p - np.median(p, axis=0), axis=1)
    return np.asarray(p[np.argsort(off)[: int(share * len(p))]])


def _fixed(target: Array, tools: Array) -> Array:
    """Return a fixed target for all tools."""
    return target


def _fifth(points: Array, others: Array) -> Array:
    """Distance (P,) of points from the fifth nearest of others, small where an arm has many ways to be."""
    return np.array([np.partition(np.linalg.norm(others - p, axis=1), 5)[5] for p in points])
