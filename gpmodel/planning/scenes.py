"""What a simulated instrument looks at or touches: which poses it takes, and what it reads there."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, Mask
from gpmodel.calibration.linearise import effect_columns
from gpmodel.errors import InputError
from gpmodel.formula.expression import ONE
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, Placement, measured_minus, observe, prepare
from gpmodel.model.instruments import with_observations
from gpmodel.model.own_pose import numbers_of
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset

INSTRUMENTS = ("tracker", "camera", "hand camera", "planes", "spheres", "points", "bar", "inclinometer")
NOISE = {"camera": ("px", 0.1), "hand camera": ("px", 0.1), "inclinometer": ("deg", 0.002)}
"""Unit and usual size of their noise; of all others that of a tracker."""
TO_SI = {"px": 1.0, "deg": np.pi / 180.0}
"""What these units are in the model's own."""
POOL = 60
"""Random poses drawn for every one that is taken: a board faces a camera at one in ten."""
FOCAL, IMAGE, BOARD, PITCH = 2400.0, (2448.0, 2048.0), (5, 4), 0.02
"""A camera of 5 megapixels: focal length and image, px; columns and rows of its board, and metres between them."""
TILTED = np.cos(np.radians(55.0))
"""Beyond it corners of a board are no longer found well."""
BAR, BALL, TOUCHES = 0.3, 0.025, 4
"""Metres of a bar and of a sphere's radius; touches of a shared point."""
CLOSE, STEPS, REDRAWN, NEARBY = 1e-9, 25, 12, 30
"""Metres a touch may be off; steps from one start; starts; random poses of which the nearest is the next start."""


@dataclass(frozen=True)
class Real:
    """A mechanism with its errors, where its root and its tool are."""

    model: ErrorModel
    theta: Array
    placement: Placement


@dataclass(frozen=True)
class Scene:
    """Poses q (N, n) to start from, spare ones (P, n) with their tool points (P, 3), and labels (N,) of what is
    touched.
    aims: tool points (N, 3) to where they go, m, in the root. described: of cameras and boards. link: that an
    inclinometer is on. own: truth of what they stand at."""

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
    """Poses of a pool (P, n) that an instrument can take, `count` of them. Raises InputError: too few of them."""
    frames = se3.chain(mechanism.transforms(pool))[-1]
    points = frames[:, :3, 3] + frames[:, :3, :3] @ tool_point
    if instrument in ("camera", "hand camera"):
        return _seen_scene(instrument == "camera", pool, frames, count, rng)
    if instrument == "inclinometer":
        link = mechanism.joints[-1].name
        return Scene(instrument, pool[:count], {"link": np.full(count, link)}, pool, points)
    near = np.argsort(np.linalg.norm(points - np.median(points, axis=0), axis=1))[: POOL // 4 * count]
    chosen = rng.choice(near, count, replace=False)
    q, there = pool[chosen], points[chosen]
    middle, own = np.median(there, axis=0), np.arange(count)
    if instrument == "planes":
        axis = own % 3
        turn = se3.exp(np.concatenate([np.zeros(3), rng.normal(0.0, 0.3, 3)]))[:3, :3]

        def flat(p: Array) -> Array:
            normal = turn.T[axis]
            return p - np.sum((p - middle) * normal, axis=1, keepdims=True) * normal

        return Scene(instrument, q, {"on_plane": np.array(["A", "B", "C"])[axis]}, pool[near], points[near], flat)
    if instrument == "spheres":
        ball = own % 3
        centre = there[:3]
        away = rng.normal(size=(count, 3))
        surface = centre[ball] + BALL * away / np.linalg.norm(away, axis=1, keepdims=True)
        return Scene(
            instrument, q, {"on_sphere": np.array(["A", "B", "C"])[ball]}, pool[near], points[near], lambda p: surface
        )
    group = own // (2 if instrument == "bar" else TOUCHES)
    target = there[np.flatnonzero(np.append(True, np.diff(group) > 0))][group]
    if instrument == "bar":
        first = target[::2]
        length = np.linalg.norm(points[near][None] - first[:, None], axis=2)
        other = np.argsort(np.abs(length - BAR), axis=1)[np.arange(len(first)), rng.integers(NEARBY, size=len(first))]
        along = points[near][other] - first
        along *= BAR / np.linalg.norm(along, axis=1, keepdims=True)
        target = target + along[group] * (own % 2)[:, None]
        return Scene(
            instrument, q, {"pair": np.array([f"B{g}" for g in group])}, pool[near], points[near], lambda p: target
        )
    return Scene(
        instrument, q, {"same_point": np.array([f"P{g}" for g in group])}, pool[near], points[near], lambda p: target
    )


def _seen_scene(outside: bool, pool: Array, frames: Array, count: int, rng: np.random.Generator) -> Scene:
    """A camera in the world and a board in the hand, or the other way round, both facing along the flange's z."""
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
    own = dict(
        zip(("camera C", "board B"), map(numbers_of, (stands, held) if outside else (held, stands)), strict=True)
    )
    return Scene("camera", pool[good[:count]], {}, pool, frames[:, :3, 3], described=described, own=own)


def _inside(seen: Array) -> Mask:
    """Whether all corners are in the image, for boards (P, 4, 4) in the camera."""
    grid = PITCH * np.array([[i, j, 0.0] for j in range(BOARD[1]) for i in range(BOARD[0])])
    points = np.einsum("pij,cj->pci", seen[:, :3, :3], grid) + seen[:, None, :3, 3]
    ahead = points[:, :, 2] > 0.1
    image = FOCAL * points[:, :, :2] / np.where(ahead, points[:, :, 2], 1.0)[:, :, None]
    return np.asarray((ahead & (np.abs(image) < 0.5 * np.array(IMAGE)).all(axis=2)).all(axis=1))


def read_in(
    scene: Scene, real: Real, empty: Dataset, noise: float, rng: np.random.Generator
) -> tuple[Dataset, Placement]:
    """What the instrument reads of a mechanism with known errors, and the placement with what it had to find.

    empty: the poses with nothing measured. noise: standard deviation of one reading, m, px or rad.
    """
    mechanism = real.model.mechanism
    if scene.aims is not None:
        q = _reached(scene, real, empty, noise, rng)
        labels = {**empty.labels, **scene.labels}
        lengths = {"length": np.full(len(q), BAR)} if scene.instrument == "bar" else {}
        data = replace(empty, q=q, labels=labels, readings=lengths)
        return with_observations(data, mechanism), real.placement
    corners = BOARD[0] * BOARD[1] if scene.own else 1
    data = empty.subset(np.repeat(np.arange(len(empty)), corners))
    data = replace(data, row=np.arange(1, len(data) + 1), described=scene.described or {})
    columns = ("u", "v") if scene.own else ("inclination_x", "inclination_y")
    labels = {k: np.repeat(v, corners) for k, v in scene.labels.items()}
    if scene.own:
        labels = {"camera": np.full(len(data), "C"), "marker": np.tile(np.arange(corners).astype(str), len(empty))}
    data = replace(data, labels={**data.labels, **labels}, readings=dict.fromkeys(columns, np.zeros(len(data))))
    own = scene.own or _mounted(scene, rng)
    there = replace(real.placement, anchors={**real.placement.anchors, **own})
    data = with_observations(data, mechanism)
    read = -measured_minus(observe(real.model, prepare(mechanism, data), real.theta, there), data)[:, 6:]
    read = read + noise * rng.normal(size=read.shape)
    data = replace(data, readings=dict(zip(columns, read.T, strict=True)))
    return with_observations(data, mechanism), there


def _mounted(scene: Scene, rng: np.random.Generator) -> dict[str, Array]:
    link = scene.labels["link"][0]
    return {"vertical": np.array([0.0, 0.0, 1.0]), f"inclinometer {link}": rng.normal(0.0, 0.3, 3)}


def _reached(scene: Scene, real: Real, empty: Dataset, noise: float, rng: np.random.Generator) -> Array:
    """Joint values (N, n) at which the real tool point is where it should touch, but for the noise of a contact."""
    assert scene.aims is not None
    mechanism, q = real.model.mechanism, scene.q.copy()
    limits = np.array([(j.lower, j.upper) for j in mechanism.joints]).T
    drives = tuple(drive_effect(j.name, j, ONE) for j in mechanism.joints)
    slip = noise * rng.normal(size=(len(q), 3))
    for step in range(1, STEPS * REDRAWN + 1):
        poses = prepare(mechanism, replace(empty, q=q.copy()))
        observed = observe(real.model, poses, real.theta, real.placement)
        points = observed.tips.root[:, :3, 3]
        miss = scene.aims(points - slip) + slip - points
        short = np.linalg.norm(miss, axis=1) > CLOSE
        if not short.any():
            return q
        if step % STEPS == 0:
            some = rng.integers(len(scene.spare), size=(short.sum(), NEARBY))
            far = np.linalg.norm(scene.points[some] - (points + miss)[short, None], axis=2)
            q[short] = scene.spare[some[np.arange(len(some)), np.argmin(far, axis=1)]]
            continue
        reach = np.swapaxes(observed.tips.turn, 1, 2) @ effect_columns(drives, real.model, poses, observed)[:, :3]
        gram = reach @ np.swapaxes(reach, 1, 2) + 1e-9 * np.eye(3)
        move = np.einsum("nij,ni->nj", reach, np.linalg.solve(gram, miss[:, :, None])[:, :, 0])
        move *= np.minimum(1.0, 0.3 / np.maximum(np.abs(move).max(axis=1, keepdims=True), 1e-12))
        q = np.clip(q + move, *limits)
    raise InputError("some poses do not reach what they should touch; try another seed or more poses")
