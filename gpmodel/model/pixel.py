"""Corners of a board in the image of a camera. Camera and board are each fixed to the world or carried by a link.

A corner x of the board is at X = (F_c C)⁻¹ F_b B x in the camera, with pose B of the board in the frame F_b of its link
and pose C of the camera in the frame F_c of its link. gpmodel.model.lens converts X to pixels. The pose B of the board,
the pose C of the camera and unknown lens parameters are estimated.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.model import lens
from gpmodel.model.observation import OfLinks, Own, Tips
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import by_pose, frame_of, numbers_of, turned

REWEIGHTED = 10
"""Number of fits of a homography, of the pose of a body, or of a hand-eye transform; each fit reduces the weights of
outliers of the previous fit."""
IN_TURN = 20
"""Number of Gauss-Newton steps for the pose of a body in a camera view between two updates of the weights."""
TURNING = 1e-3
"""Smallest ratio of the second smallest to the largest singular value of a hand-eye calibration. With a smaller ratio,
all camera views rotate about one axis."""
METRES_A_PIXEL = 1e-3
"""Assumed size of a pixel at the board, m, if every image shows one point only."""
FEWEST_VIEWS = 3
"""Least number of camera views of a board: two rotations about two axes determine a hand-eye transform."""


def homography(flat: Array, seen: Array) -> Array:
    """Return the homography (3, 3) from points `flat` (corners, 2) of a board, m, to image points `seen` (corners, 2).
    The fit of the homography is robust to wrong corners. Source: Zhang (2000)."""
    ones = np.ones(len(flat))
    (board, a), (image, b) = _normalised(flat), _normalised(seen)
    source, weight = np.column_stack([board, ones]), ones.copy()
    for _ in range(REWEIGHTED):
        rows = np.zeros((2 * len(flat), 9))
        rows[::2, :3], rows[::2, 6:] = source, -image[:, :1] * source
        rows[1::2, 3:6], rows[1::2, 6:] = source, -image[:, 1:] * source
        h = np.linalg.svd(rows * np.repeat(weight, 2)[:, None])[2][-1].reshape(3, 3)
        mapped = source @ h.T
        off = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - image, axis=1)
        weight = _trusted(off)
    out = np.linalg.solve(b, h @ a)
    return out / float(np.linalg.norm(out))


def _normalised(points: Array) -> tuple[Array, Array]:
    """Return points (points, 2) scaled to mean zero and standard deviation one, and the 3 x 3 matrix of the scaling."""
    middle, size = points.mean(axis=0), points.std() or 1.0
    scale = np.array([[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1.0]])
    return (points - middle) / size, scale


def lens_from(homographies: list[Array]) -> Array:
    """Return fx, fy, cx, cy of a lens, px, from homographies of a board, without skew. Source: Zhang (2000)."""

    def row(h: Array, i: int, j: int) -> Array:
        a, b = h[:, i], h[:, j]
        return np.array([a[0] * b[0], a[1] * b[1], a[2] * b[0] + a[0] * b[2], a[2] * b[1] + a[1] * b[2], a[2] * b[2]])

    scale = np.diag([1e-3, 1e-3, 1.0])
    system = [r for h in (scale @ h for h in homographies) for r in (row(h, 0, 1), row(h, 0, 0) - row(h, 1, 1))]
    b11, b22, b13, b23, b33 = np.linalg.svd(np.array(system))[2][-1]
    cx, cy = -b13 / b11, -b23 / b22
    size = b33 - b13**2 / b11 - b23**2 / b22
    if size / b11 <= 0 or size / b22 <= 0:
        raise InputError("the views do not determine the focal length; expected the board tilted in several directions")
    return 1e3 * np.array([np.sqrt(size / b11), np.sqrt(size / b22), cx, cy])


def flattened(board: Array) -> tuple[Array, Array]:
    """Return a frame (4, 4) in which the points of a board are in the plane z = 0, and the points' distances from that
    plane."""
    middle = board.mean(axis=0)
    axes = np.linalg.svd(board - middle, full_matrices=False)[2]
    out = se3.frame(np.column_stack([axes[0], axes[1], np.cross(axes[0], axes[1])]), middle)
    return out, np.abs((board - middle) @ out[:3, 2])


def view_pose(board: Array, seen: Array, plane: Array | None) -> Array:
    """Return the pose (4, 4) of a board in the camera frame, from its corners (corners, 3), m, and their directions.

    plane: frame (4, 4) of the plane of a flat board; None for a body that is not flat.
    """
    if plane is None:
        return _body_pose(board, seen)
    flat = (board - plane[:3, 3]) @ plane[:3, :2]
    h = homography(flat, seen)
    h = h / np.linalg.norm(h[:, 0]) * (np.sign(h[2, 2]) or 1.0)
    rough = np.column_stack([h[:, 0], h[:, 1], np.cross(h[:, 0], h[:, 1])])
    place = h[:, 2] / np.mean(np.linalg.norm(h[:, :2], axis=0))
    return se3.frame(se3.nearest_rotation(rough), place) @ np.linalg.inv(plane)


def _body_pose(body: Array, seen: Array) -> Array:
    """Estimate the pose (4, 4) of a body whose points are not in one plane, in the frame of the camera.

    The initial pose assumes weak perspective. The translation fits the lines of sight given the rotation; the rotation
    fits the nearest points on them. Iterations reduce the weights of outliers. Source: Lu, Hager and Mjolsness (2000).
    """
    sight = np.column_stack([seen, np.ones(len(seen))])
    onto = sight[:, :, None] * sight[:, None, :] / np.sum(sight**2, axis=1)[:, None, None]
    weight = np.ones(len(body))

    def turned_onto(target: Array) -> Array:
        middle, there = weight @ body / weight.sum(), weight @ target / weight.sum()
        return se3.nearest_rotation((weight[:, None] * (target - there)).T @ (body - middle))

    turn = turned_onto(sight)
    for _ in range(REWEIGHTED):
        for _ in range(IN_TURN):
            turned = body @ turn.T
            away = np.einsum("n,nij,nj->i", weight, onto - np.eye(3), turned)
            shift = np.linalg.solve(np.einsum("n,nij->ij", weight, np.eye(3) - onto), away)
            near = np.einsum("nij,nj->ni", onto, turned + shift)
            turn = turned_onto(near)
        placed = body @ turn.T + shift
        off = np.linalg.norm(placed[:, :2] / placed[:, 2:] - seen, axis=1)
        weight = _trusted(off)
    return se3.frame(turn, shift)


def hand_eye(moved: Array, seen: Array) -> tuple[Array, Array]:
    """Solve A B = C T over all views for poses B of a board and C of a camera in their links.
    moved: A (views, 4, 4), board's link in the camera's link. seen: T (views, 4, 4), board in the camera.
    Raises InputError if the views do not determine B and C. Source: Shah (2013).
    """
    if len(moved) < FEWEST_VIEWS:
        raise InputError(f"{len(moved)} poses; expected at least {FEWEST_VIEWS}")
    eye, weight = np.eye(3), np.ones(len(moved))
    for _ in range(REWEIGHTED):
        rows = [
            w * np.hstack([np.kron(a, eye), -np.kron(eye, t.T)])
            for w, a, t in zip(weight, moved[:, :3, :3], seen[:, :3, :3], strict=True)
        ]
        _, size, vt = np.linalg.svd(np.vstack(rows))
        if size[-2] < TURNING * size[0]:
            raise InputError(
                "the board turns about one axis only; expected poses that rotate the board about two more axes"
            )
        sign = np.sign(np.linalg.det(vt[-1][:9].reshape(3, 3)))
        turn, eye_turn = [se3.nearest_rotation(sign * vt[-1][k : k + 9].reshape(3, 3)) for k in (0, 9)]
        off = np.linalg.norm(moved[:, :3, :3] @ turn - eye_turn @ seen[:, :3, :3], axis=(1, 2))
        weight = _trusted(off)
    system = np.concatenate([w * np.hstack([a[:3, :3], -eye]) for w, a in zip(weight, moved, strict=True)])
    right = weight[:, None] * (seen[:, :3, 3] @ eye_turn.T - moved[:, :3, 3])
    places = np.linalg.lstsq(system, right.ravel(), rcond=None)[0]
    return se3.frame(turn, places[:3]), se3.frame(eye_turn, places[3:])


def middle_of(frames: Array) -> Array:
    """Return an average (4, 4) of several frames: the median of the positions, the mean of the rotations."""
    return se3.frame(se3.nearest_rotation(frames[:, :3, :3].mean(axis=0)), np.median(frames[:, :3, 3], axis=0))


def _trusted(off: Array) -> Array:
    """Return robust weights for distances `off` of points, small for distances far beyond the median."""
    return np.asarray(1.0 / (1.0 + (off / (3.0 * np.median(off) + 1e-12)) ** 2))


WORLD = -1
"""Frame number of a camera or board that does not move."""


FEWEST_CORNERS, FEWEST_MARKERS = 4, 6
"""Least number of a board's corners, and of a body's markers, in one camera view. Fewer corners do not determine the
pose of a board; fewer markers do not determine the pose of a body if some are wrong."""
FLAT = 1e-3
"""Largest distance of a board's corners from one plane, as a fraction of its size."""


@dataclass(frozen=True, eq=False)
class Mounted:
    """A camera or a board: its name, and the number of the frame (slot) that carries it, -1 (WORLD) for none."""

    name: str
    slot: int


@dataclass(frozen=True, eq=False)
class Camera(Mounted):
    """A camera with nine lens parameters as lens.NAMES, zero if unknown. solved: positions of estimated parameters."""

    lens: Array
    solved: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Board(Mounted):
    """A calibration board or body. corners: positions (corners, 3), m, of corners or markers; a view may show a few."""

    corners: Array

    @cached_property
    def flat(self) -> bool:
        """True if the corners of the board are in one plane."""
        off = flattened(self.corners)[1].max()
        return bool(off <= FLAT * np.ptp(self.corners, axis=0).max())


def pixel_size(values: Array, corner: Array, image: IntArray) -> float:
    """Return the median size of one pixel at the boards, m: extent of the corners of an image over extent in pixels.

    The extent is the largest singular value: its direction is the least foreshortened. image: number of the image of
    each row.
    """
    ratios = []
    for rows in (np.flatnonzero(image == k) for k in np.unique(image)):
        board, seen = (np.linalg.norm(x[rows] - x[rows].mean(axis=0), 2) for x in (corner, values))
        if board > 0.0 and seen > 0.0:
            ratios.append(board / seen)
    return float(np.median(ratios)) if ratios else METRES_A_PIXEL


@dataclass(frozen=True, eq=False)
class Pixels(OfLinks):
    """Measured pixels of corners. camera, board: index of the camera and of the board of each row, -1 for no
    measurement.

    values: pixels (rows, 2). corner: point on its board, m. view: index of the image of each row. metres: size of a
    pixel at the board, m."""

    values: Array
    cameras: tuple[Camera, ...]
    boards: tuple[Board, ...]
    camera: IntArray
    board: IntArray
    corner: Array
    view: IntArray
    metres: float
    name: ClassVar[str] = "pixel"
    unit: ClassVar[str] = "px"

    @cached_property
    def own(self) -> Mapping[str, tuple[str, ...]]:
        """Unknowns of camera measurements: poses of cameras and boards, and parameters of the lenses."""
        out: dict[str, tuple[str, ...]] = {f"camera {c.name}": AXES for c in self.cameras}
        out |= {f"board {b.name}": AXES for b in self.boards}
        return out | {f"lens {c.name}": tuple(lens.NAMES[k] for k in c.solved) for c in self.cameras if c.solved}

    @property
    def kept(self) -> tuple[str, ...]:
        """Keys of cameras and boards that links carry, and of the estimated parameters of the lenses."""
        carried = [f"camera {c.name}" for c in self.cameras if c.slot != WORLD]
        carried += [f"board {b.name}" for b in self.boards if b.slot != WORLD]
        return (*carried, *(f"lens {c.name}" for c in self.cameras if c.solved))

    def subset(self, rows: IntArray) -> "Pixels":
        return replace(
            self, values=self.values[rows], camera=self.camera[rows], board=self.board[rows], corner=self.corner[rows],
            view=self.view[rows],
        )  # fmt: skip

    def residual(self, tips: Tips, own: Own) -> Array:
        seen = self._seen(tips, own)
        return np.where(self.readings, self.values - lens.pixels(seen.points, seen.lens), np.nan)

    def by_slots(self, tips: Tips, own: Own) -> Mapping[int, Array]:
        """Return the derivatives of pixels with respect to the frames of the links that carry a camera or a board."""
        seen, out = self._seen(tips, own), dict[int, Array]()
        change = lens.by_point(seen.points, seen.lens) @ np.swapaxes(seen.camera[:, :3, :3], 1, 2)
        for which, carried, sign in ((self.camera, self.cameras, -1.0), (self.board, self.boards, 1.0)):
            for i, part in enumerate(carried):
                if part.slot != WORLD:
                    lever = seen.world - tips.slots[part.slot, :, :3, 3]
                    motion = np.concatenate([np.broadcast_to(np.eye(3), (len(lever), 3, 3)), -se3.hat(lever)], axis=2)
                    moved = sign * (change @ motion) * (which == i)[:, None, None]
                    out[part.slot] = out.get(part.slot, np.zeros_like(moved)) + moved
        return out

    def by_own(self, tips: Tips, own: Own) -> Array:
        seen = self._seen(tips, own)
        change = lens.by_point(seen.points, seen.lens)
        to_camera = np.swapaxes(seen.camera[:, :3, :3], 1, 2) @ seen.board[:, :3, :3]
        by_camera, by_board = change @ by_pose(seen.points), -(change @ to_camera) @ by_pose(self.corner)
        parts = [by_camera * (self.camera == i)[:, None, None] for i in range(len(self.cameras))]
        parts += [by_board * (self.board == i)[:, None, None] for i in range(len(self.boards))]
        numbers = lens.by_lens(seen.points, seen.lens)
        for i, c in enumerate(self.cameras):
            if c.solved:
                parts.append(numbers[:, :, c.solved] * (self.camera == i)[:, None, None])
        return np.concatenate(parts, axis=2)

    def moved(self, key: str, value: Array, step: Array) -> Array:
        """Return the pose of a camera or board after a twist in its own axes, or lens parameters plus a step."""
        return value + step if key.startswith("lens ") else turned(value, step)

    def start(self, tips: Tips) -> Own:
        """Return initial values in closed form: lenses, poses of the views, then cameras and boards pair by pair.

        Raises InputError if the camera views do not determine the initial values.
        """
        lenses = [self._lens(i, c) for i, c in enumerate(self.cameras)]
        cameras: dict[int, Array] = {}
        boards: dict[int, Array] = {}
        pairs = sorted(self._pairs(), key=lambda pair: -len(self._views(*pair)))
        while pairs:
            pair = next((p for p in pairs if p[0] in cameras or p[1] in boards), pairs[0])
            pairs.remove(pair)
            moved, seen = self._posed(tips, pair, lenses[pair[0]])
            if pair[0] in cameras:
                found = np.linalg.inv(moved) @ cameras[pair[0]] @ seen
                boards.setdefault(pair[1], middle_of(found))
            elif pair[1] in boards:
                cameras[pair[0]] = middle_of(moved @ boards[pair[1]] @ np.linalg.inv(seen))
            else:
                try:
                    boards[pair[1]], cameras[pair[0]] = hand_eye(moved, seen)
                except InputError as error:
                    raise InputError(f"camera '{self.cameras[pair[0]].name}': {error.said}") from None
        out = {f"camera {c.name}": numbers_of(cameras[i]) for i, c in enumerate(self.cameras)}
        out |= {f"board {b.name}": numbers_of(boards[i]) for i, b in enumerate(self.boards)}
        return out | {f"lens {c.name}": lenses[i][list(c.solved)] for i, c in enumerate(self.cameras) if c.solved}

    def _pairs(self) -> list[tuple[int, int]]:
        seen = self.readings.all(axis=1)
        return sorted({*zip(self.camera[seen].tolist(), self.board[seen].tolist(), strict=True)})

    def _views(self, camera: int, board: int) -> list[IntArray]:
        rows = np.flatnonzero(self.readings.all(axis=1) & (self.camera == camera) & (self.board == board))
        views = [rows[self.view[rows] == view] for view in np.unique(self.view[rows])]
        needed = FEWEST_CORNERS if self.boards[board].flat else FEWEST_MARKERS
        most = max(map(len, views), default=0)
        return [view for view in views if len(view) >= max(FEWEST_CORNERS, min(needed, most))]

    def _lens(self, i: int, camera: Camera) -> Array:
        """Return the nine lens parameters of a camera, with unknown parameters from Zhang's homographies."""
        out = camera.lens.copy()
        if missing := [k for k in camera.solved if k < 4 and out[k] == 0.0]:
            found = [*self._homographies(i)]
            if not found:
                raise InputError(
                    f"camera '{camera.name}': the views of a flat board do not determine the focal "
                    "length; expected focal_px"
                )
            out[missing] = lens_from(found)[missing]
        return out

    def _homographies(self, camera: int) -> Iterator[Array]:
        for pair in self._pairs():
            if pair[0] == camera and self.boards[pair[1]].flat:
                plane = flattened(self.boards[pair[1]].corners)[0]
                for rows in self._views(*pair):
                    flat = (self.corner[rows] - plane[:3, 3]) @ plane[:3, :2]
                    yield homography(flat, self.values[rows])

    def _posed(self, tips: Tips, pair: tuple[int, int], known: Array) -> tuple[Array, Array]:
        """Return for each view of a camera and a board two poses (views, 4, 4): the board's link in the camera's link,
        and the board in the camera."""
        camera, board = self.cameras[pair[0]], self.boards[pair[1]]
        plane = flattened(board.corners)[0] if board.flat else None
        moved, seen = [], []
        for rows in self._views(*pair):
            frames = [np.eye(4) if p.slot == WORLD else tips.slots[p.slot, rows[0]] for p in (camera, board)]
            moved.append(np.linalg.solve(*frames))
            seen.append(view_pose(self.corner[rows], lens.directions(self.values[rows], known), plane))
        return np.array(moved), np.array(seen)

    def _seen(self, tips: Tips, own: Own) -> "_View":
        cameras = _placed(tips, [(c.slot, own[f"camera {c.name}"]) for c in self.cameras], self.camera)
        boards = _placed(tips, [(b.slot, own[f"board {b.name}"]) for b in self.boards], self.board)
        world = np.einsum("nij,nj->ni", boards[:, :3, :3], self.corner) + boards[:, :3, 3]
        points = np.einsum("nji,nj->ni", cameras[:, :3, :3], world - cameras[:, :3, 3])
        numbers = np.array([c.lens for c in self.cameras])
        for i, c in enumerate(self.cameras):
            if c.solved:
                numbers[i, list(c.solved)] = own[f"lens {c.name}"]
        return _View(cameras, boards, world, np.where(self.readings[:, :1], points, 1.0), numbers[self.camera])


@dataclass(frozen=True)
class _View:
    """Poses of `camera` and `board` in the root frame, (rows, 4, 4); board corners in the root frame (`world`) and in
    the camera frame (`points`), (rows, 3), m; lens parameters (rows, 9)."""

    camera: Array
    board: Array
    world: Array
    points: Array
    lens: Array


def _placed(tips: Tips, parts: list[tuple[int, Array]], which: IntArray) -> Array:
    """Return the pose (4, 4) in the root frame of the camera or board of each row. which: index in `parts` of the
    camera or board of each row."""
    out = np.broadcast_to(np.eye(4), (len(which), 4, 4)).copy()
    for i, (slot, value) in enumerate(parts):
        rows = which == i
        out[rows] = frame_of(value) if slot == WORLD else tips.slots[slot, rows] @ frame_of(value)
    return out
