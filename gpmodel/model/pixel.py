"""Corners of a board seen by a camera, either of them fixed to the world or carried by a link.

X = (F_c C)⁻¹ F_b B x: a corner x (3,) of the board, its pose B in its carrier F_b, the camera's pose C in its carrier
F_c; pixels by gpmodel.model.lens. B, C and what of the lens is not known are solved.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.model import camera_start, lens
from gpmodel.model.observation import Own, Tips
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import by_pose, frame_of, numbers_of, turned

WORLD = -1
"""The carrier of what stands still."""


FEWEST_CORNERS, FEWEST_MARKERS = 4, 6
"""Smallest number of corners and of markers in one view.

Fewer corners leave the pose of a board open; fewer markers leave that of a body open if some are wrong.
"""
FLAT = 1e-3
"""Largest distance of a board's corners from one plane, as a fraction of its size."""


@dataclass(frozen=True, eq=False)
class Mounted:
    """A camera or a board: its name, and the slot of the link that carries it, by index, or WORLD."""

    name: str
    slot: int


@dataclass(frozen=True, eq=False)
class Camera(Mounted):
    """lens: (9,) as lens.NAMES, zero where not known. solved: which of these are to be found."""

    lens: Array
    solved: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Board(Mounted):
    """corners: (P, 3) of all its corners, m, or of markers around a body, of which a view has some."""

    corners: Array

    @cached_property
    def flat(self) -> bool:
        """True if the corners are in one plane."""
        off = camera_start.flattened(self.corners)[1].max()
        return bool(off <= FLAT * np.ptp(self.corners, axis=0).max())


@dataclass(frozen=True, eq=False)
class Pixels:
    """values: (N, 2) u v, px. camera, board: (N,) which, -1 where nothing was seen. corner: (N, 3) of its board, m.
    view: (N,) code of the pose. metres: what a pixel counts as."""

    values: Array
    cameras: tuple[Camera, ...]
    boards: tuple[Board, ...]
    camera: IntArray
    board: IntArray
    corner: Array
    view: IntArray
    metres: float
    name: str = field(default="pixel", init=False)
    unit: str = field(default="px", init=False)
    components: int = field(default=2, init=False)
    absolute: bool = field(default=False, init=False)
    oriented: bool = field(default=False, init=False)

    @cached_property
    def own(self) -> Mapping[str, tuple[str, ...]]:
        """Poses of cameras and boards, and what of a lens is not known."""
        out: dict[str, tuple[str, ...]] = {f"camera {c.name}": AXES for c in self.cameras}
        out |= {f"board {b.name}": AXES for b in self.boards}
        return out | {f"lens {c.name}": tuple(lens.NAMES[k] for k in c.solved) for c in self.cameras if c.solved}

    @property
    def kept(self) -> tuple[str, ...]:
        """Cameras and boards that links carry, and what is solved of a lens."""
        carried = [f"camera {c.name}" for c in self.cameras if c.slot != WORLD]
        carried += [f"board {b.name}" for b in self.boards if b.slot != WORLD]
        return (*carried, *(f"lens {c.name}" for c in self.cameras if c.solved))

    @property
    def readings(self) -> Mask:
        """Measured components (N, 2), True where finite."""
        return np.isfinite(self.values)

    def subset(self, rows: IntArray) -> "Pixels":
        return replace(
            self, values=self.values[rows], camera=self.camera[rows], board=self.board[rows], corner=self.corner[rows],
            view=self.view[rows],
        )  # fmt: skip

    def residual(self, tips: Tips, own: Own) -> Array:
        seen = self._seen(tips, own)
        return np.where(self.readings, self.values - lens.pixels(seen.points, seen.lens), np.nan)

    def by_tip(self, tips: Tips, own: Own) -> Array:
        """Nothing: the tool point is not seen."""
        return np.zeros((len(self.values), 2, 6))

    def by_slots(self, tips: Tips, own: Own) -> Mapping[int, Array]:
        """By the frames of the links that carry a camera or a board."""
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
        """A pose after a twist in its own axes; numbers of a lens are added to."""
        return value + step if key.startswith("lens ") else turned(value, step)

    def start(self, tips: Tips) -> Own:
        """In closed form, whatever anybody believed: lens, poses of the views, then cameras and boards pair by pair.

        Raises InputError where the views do not determine them.
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
                boards.setdefault(pair[1], camera_start.middle_of(found))
            elif pair[1] in boards:
                cameras[pair[0]] = camera_start.middle_of(moved @ boards[pair[1]] @ np.linalg.inv(seen))
            else:
                try:
                    boards[pair[1]], cameras[pair[0]] = camera_start.hand_eye(moved, seen)
                except InputError as error:
                    raise InputError(f"camera '{self.cameras[pair[0]].name}': {error.said}") from None
        out = {f"camera {c.name}": numbers_of(cameras[i]) for i, c in enumerate(self.cameras)}
        out |= {f"board {b.name}": numbers_of(boards[i]) for i, b in enumerate(self.boards)}
        return out | {f"lens {c.name}": lenses[i][list(c.solved)] for i, c in enumerate(self.cameras) if c.solved}

    def depth(self, tips: Tips, own: Own) -> float:
        """Median metres at which one pixel is seen: the distance of a corner over the focal length."""
        seen, rows = self._seen(tips, own), self.readings.all(axis=1)
        return float(np.median(seen.points[rows, 2] / seen.lens[rows, 0]))

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
        """(9,), what is not known of it by Zhang's homographies."""
        out = camera.lens.copy()
        if missing := [k for k in camera.solved if k < 4 and out[k] == 0.0]:
            found = [*self._homographies(i)]
            if not found:
                raise InputError(f"camera '{camera.name}': no flat board shows its focal length; expected focal_px")
            out[missing] = camera_start.lens_from(found)[missing]
        return out

    def _homographies(self, camera: int) -> Iterator[Array]:
        for pair in self._pairs():
            if pair[0] == camera and self.boards[pair[1]].flat:
                plane = camera_start.flattened(self.boards[pair[1]].corners)[0]
                for rows in self._views(*pair):
                    flat = (self.corner[rows] - plane[:3, 3]) @ plane[:3, :2]
                    yield camera_start.homography(flat, self.values[rows])

    def _posed(self, tips: Tips, pair: tuple[int, int], known: Array) -> tuple[Array, Array]:
        """Return for every view of a pair the board's carrier in the frame of the camera's carrier, and the board in
        the camera (V, 4, 4).
        """
        camera, board = self.cameras[pair[0]], self.boards[pair[1]]
        plane = camera_start.flattened(board.corners)[0] if board.flat else None
        moved, seen = [], []
        for rows in self._views(*pair):
            frames = [np.eye(4) if p.slot == WORLD else tips.slots[p.slot, rows[0]] for p in (camera, board)]
            moved.append(np.linalg.solve(*frames))
            seen.append(camera_start.view_pose(self.corner[rows], lens.directions(self.values[rows], known), plane))
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
    """camera, board: (N, 4, 4) in the root. world, points: (N, 3) the corner there and in the camera, m. lens: (N,
    9)."""

    camera: Array
    board: Array
    world: Array
    points: Array
    lens: Array


def _placed(tips: Tips, parts: list[tuple[int, Array]], which: IntArray) -> Array:
    """Where some of them are in the root (N, 4, 4), by which each row has."""
    out = np.broadcast_to(np.eye(4), (len(which), 4, 4)).copy()
    for i, (slot, value) in enumerate(parts):
        rows = which == i
        out[rows] = frame_of(value) if slot == WORLD else tips.slots[slot, rows] @ frame_of(value)
    return out
