"""Targets and surfaces of a simulated instrument, and the poses in which it can measure."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError
from gpmodel.mechanism.branches import branched
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import numbers_of

INSTRUMENTS = ("tracker", "camera", "hand camera", "planes", "spheres", "points", "bar", "inclinometer")
NOISE = {"camera": ("pixels", "0.1 px"), "hand camera": ("pixels", "0.1 px"), "inclinometer": ("angle", "0.002 deg")}
"""Dimension and usual standard deviation of the noise of some instruments. All others have that of a tracker."""
POOL = 60
"""Random poses drawn for each pose that is kept. In one of ten poses the camera can see the board."""
FOCAL, IMAGE, BOARD, PITCH = 2400.0, (2448.0, 2048.0), (5, 4), 0.02
"""A camera of 5 megapixels and its board: focal length and image size, px; columns and rows of corners, and their
distance, m."""
TILTED = np.cos(np.radians(55.0))
"""Cosine of the largest tilt of a board at which its corners are located well."""
BAR, BALL, TOUCHES = 0.3, 0.025, 4
"""Length of a bar and radius of a sphere, m; number of touches of a shared point."""
NEARBY = 30
"""Random poses from which the pose nearest to a target, or one of the nearest, is taken."""


@dataclass(frozen=True)
class Scene:
    """Poses and targets of a simulated measurement. Pose k is of arm k modulo A.

    q: joint values (N, n) to start from.
    labels: name (N,) of the touched object, per label column.
    spare: joint values (P, n) of other starting poses; points: their tool points (A, P, 3) for every arm, m.
    aims: maps tool points (N, 3) to the points that they have to touch, m, in the root frame.
    described: description of cameras and boards, as in their TOML files.
    own: true poses of camera and board as six numbers, m and rad, by name.
    """

    instrument: str
    q: Array
    labels: Mapping[str, NDArray[np.str_]]
    spare: Array
    points: Array
    aims: Callable[[Array], Array] | None = None
    described: Mapping[str, Mapping[str, object]] | None = None
    own: Mapping[str, Array] | None = None


def scene_of(
    instrument: str, mechanism: Mechanism, pool: Array, count: int, tool_point: Array, rng: np.random.Generator
) -> Scene:
    """Select `count` poses of a pool (P, n) that an instrument can measure, and their targets.
    Raises InputError if too few poses can be measured."""
    slots, tree = se3.chain(mechanism.transforms(pool)), branched(mechanism)
    if tree is not None:
        tips = slots[[mechanism.slots.index(slot) for slot in tree.tips.values()]]
        return _two_armed(instrument, pool, tips[..., :3, 3] + tips[..., :3, :3] @ tool_point, count, rng)
    frames = slots[-1]
    points = frames[:, :3, 3] + frames[:, :3, :3] @ tool_point
    if instrument in ("camera", "hand camera"):
        return _seen_scene(instrument == "camera", pool, frames, count, rng)
    if instrument == "inclinometer":
        link = mechanism.joints[-1].name
        return Scene(instrument, pool[:count], {"link": np.full(count, link)}, pool, points[None])
    return _touched(instrument, pool, points, count, rng)


def _touched(instrument: str, pool: Array, points: Array, count: int, rng: np.random.Generator) -> Scene:
    """Place surfaces, shared points or bars near the middle of the tool points (P, 3), m."""
    near = np.argsort(np.linalg.norm(points - np.median(points, axis=0), axis=1))[: POOL // 4 * count]
    chosen = rng.choice(near, count, replace=False)
    q, there, own = pool[chosen], points[chosen], np.arange(count)
    middle = target = np.median(there, axis=0)

    def aims(p: Array) -> Array:
        return np.asarray(target)

    if instrument == "planes":
        axis = own % 3
        turn = se3.exp(np.concatenate([np.zeros(3), rng.normal(0.0, 0.3, 3)]))[:3, :3]

        def flat(p: Array) -> Array:
            normal = turn.T[axis]
            return np.asarray(p - np.sum((p - middle) * normal, axis=1, keepdims=True) * normal)

        labels, aims = {"on_plane": np.array(["A", "B", "C"])[axis]}, flat
    elif instrument == "spheres":
        ball = own % 3
        away = rng.normal(size=(count, 3))
        target = there[:3][ball] + BALL * away / np.linalg.norm(away, axis=1, keepdims=True)
        labels = {"on_sphere": np.array(["A", "B", "C"])[ball]}
    else:
        group = own // (2 if instrument == "bar" else TOUCHES)
        target = there[np.flatnonzero(np.append(True, np.diff(group) > 0))][group]
        label, letter = ("pair", "B") if instrument == "bar" else ("same_point", "P")
        labels = {label: np.array([f"{letter}{g}" for g in group])}
    if instrument == "bar":
        first = target[::2]
        length = np.linalg.norm(points[near][None] - first[:, None], axis=2)
        other = np.argsort(np.abs(length - BAR), axis=1)[np.arange(len(first)), rng.integers(NEARBY, size=len(first))]
        along = points[near][other] - first
        along *= BAR / np.linalg.norm(along, axis=1, keepdims=True)
        target = target + along[group] * (own % 2)[:, None]
    return Scene(instrument, q, labels, pool[near], points[None, near], aims)


def _two_armed(instrument: str, pool: Array, points: Array, count: int, rng: np.random.Generator) -> Scene:
    """Place shared points that every arm touches in turn, near tool points (A, P, 3), m."""
    if instrument != "points":
        raise InputError(f"{instrument} is of one arm; expected tracker or points of several", "instrument")
    own, known = np.arange(count), [cKDTree(arm) for arm in points]
    apart = np.max([tree.query(points[0])[0] for tree in known], axis=0)
    within = np.argsort(apart)[: POOL // 4 * (1 + count // TOUCHES)]
    target = points[0][rng.choice(within, 1 + count // TOUCHES, replace=False)][own // TOUCHES]
    start = [int(known[k % len(points)].query(target[k], TOUCHES)[1][k % TOUCHES]) for k in own]
    labels = {"same_point": np.array([f"P{k // TOUCHES}" for k in own])}
    return Scene(instrument, pool[start], labels, pool, points, lambda p: target)


def _seen_scene(outside: bool, pool: Array, frames: Array, count: int, rng: np.random.Generator) -> Scene:
    """Place a camera in the world and a board in the hand (`outside`), or the reverse, facing along the flange's z
    axis."""
    middle = np.median(frames[:, :3, 3], axis=0)
    distance = 2.5 * float(np.median(np.linalg.norm(frames[:, :3, 3] - middle, axis=1))) + 0.3
    z = frames[rng.integers(len(frames)), :3, 2]
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    stands = np.eye(4)
    stands[:3, :3] = np.column_stack([x, -np.cross(z, x), -z])
    stands[:3, 3] = middle + distance * z
    held = se3.exp(np.concatenate([rng.normal(0.0, 0.02, 3), rng.normal(0.0, 0.05, 3)]))
    camera, board = (stands, frames @ held) if outside else (frames @ held, stands)
    seen = np.linalg.inv(camera) @ board
    facing = np.abs(seen[:, 2, 2]) > TILTED if outside else -seen[:, 2, 2] > TILTED
    good = np.flatnonzero(facing & _inside(seen))
    if len(good) < count:
        raise InputError(
            f"only {len(good)} of {len(pool)} random poses show the board; expected at most that many poses"
        )
    names = ("world", "tool") if outside else ("tool", "world")
    lens = {"focal_px": [FOCAL, FOCAL], "centre_px": [v / 2 for v in IMAGE]}
    described: dict[str, Mapping[str, object]] = {
        "cameras": {"camera": {"C": {"link": names[0], **lens}}},
        "board": {"board": {"B": {"link": names[1], "columns": BOARD[0], "rows": BOARD[1], "pitch_mm": 1e3 * PITCH}}},
    }
    placed = map(numbers_of, (stands, held) if outside else (held, stands))
    own = dict(zip(("camera C", "board B"), placed, strict=True))
    return Scene("camera", pool[good[:count]], {}, pool, frames[None, :, :3, 3], described=described, own=own)


def _inside(seen: Array) -> Mask:
    """Return whether all corners are in the image, for boards (P, 4, 4) in the camera frame."""
    grid = PITCH * np.array([[i, j, 0.0] for j in range(BOARD[1]) for i in range(BOARD[0])])
    points = np.einsum("pij,cj->pci", seen[:, :3, :3], grid) + seen[:, None, :3, 3]
    ahead = points[:, :, 2] > 0.1
    image = FOCAL * points[:, :, :2] / np.where(ahead, points[:, :, 2], 1.0)[:, :, None]
    return np.asarray((ahead & (np.abs(image) < 0.5 * np.array(IMAGE)).all(axis=2)).all(axis=1))
