"""Touches of objects at unknown positions by the tool point: surfaces, a shared point, the two ends of a bar.

A touched body has one unknown pose S in the root frame. A feature is a surface with pose F in a body. With the tool
point p and y = (S F)⁻¹ p in the frame of the feature, the measurement is a gap g(y) of zero.

A bar of length L is touched at both ends, p1 and p2. The bar is taken to lie on the line through the touches, centred
on their middle. The gap at each end is (|p2 - p1| - L) / 2 along the bar. Only the position of a bar along the line
through its touches is an unknown of the linear problem.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.observation import OfTip, Own, Tips
from gpmodel.model.surfaces import SURFACES, Surface, aligned
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import by_pose, frame_of, numbers_of, turned


@dataclass(frozen=True, eq=False)
class Feature:
    """A surface fixed to a body.

    surface: kind of surface, such as "on_plane".
    frame: pose (4, 4) of the surface in the body.
    radius: radius of the surface, m; NaN if unknown.
    """

    surface: str
    label: str
    frame: Array = field(default_factory=lambda: np.eye(4))
    radius: float = 0.0

    @property
    def shape(self) -> Surface:
        """Kind of the touched surface, with its number of touches and its gap function."""
        return SURFACES[self.surface]


@dataclass(frozen=True, eq=False)
class Artefact:
    """A rigid body with one unknown pose that the tool touches.

    name: key of the body's unknowns.
    axes: indices, in the order Tx to Rz, of the observable twists of the body's frame.
    features: touched surfaces of the body.
    """

    name: str
    axes: tuple[int, ...]
    features: tuple[Feature, ...]

    @property
    def sized(self) -> bool:
        """True if the radius of the body is estimated."""
        return bool(np.isnan(self.features[0].radius))

    @property
    def is_bar(self) -> bool:
        """True if the body is a bar: two ends at a known distance."""
        return self.features[0].surface == "end"

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of a touched body's unknowns: observable twists of its frame, and the radius if it is estimated."""
        return (*(AXES[axis] for axis in self.axes), *(("radius",) if self.sized else ()))


@dataclass(frozen=True, eq=False)
class Touches(OfTip):
    """Gaps of tool point and touched surface, measured as zero, m. body, feature: indices of body and surface, or
    -1."""

    name: str
    bodies: tuple[Artefact, ...]
    body: IntArray
    feature: IntArray
    absolute: ClassVar[bool] = False
    oriented: ClassVar[bool] = False

    @cached_property
    def components(self) -> int:
        """Largest number of components of the gap between tool point and touched surface."""
        each = (int(f.shape.slope(np.ones((1, 3))).shape[1]) for body in self.bodies for f in body.features)
        return max(each, default=0)

    @cached_property
    def own(self) -> Mapping[str, tuple[str, ...]]:
        """Unknowns of the touches: the pose of every body."""
        return {body.name: body.unknowns for body in self.bodies}

    @cached_property
    def readings(self) -> Mask:
        """Mask (rows, components) of the measured gap components between tool point and surface."""
        out = np.zeros((len(self.body), self.components), dtype=bool)
        for shape, rows in self._rows:
            out[rows, : shape.slope(np.ones((1, 3))).shape[1]] = True
        return out

    @cached_property
    def _rows(self) -> list[tuple[Surface, IntArray]]:
        """Numbers of the rows of the table that touched each kind of surface."""
        kinds = np.array(["" if b < 0 else self.bodies[b].features[f].surface for b, f in self._each])
        return [(SURFACES[kind], np.flatnonzero(kinds == kind)) for kind in sorted({*kinds.tolist()} - {""})]

    @property
    def _each(self) -> list[tuple[int, int]]:
        return list(zip(self.body.tolist(), self.feature.tolist(), strict=True))

    def subset(self, rows: IntArray) -> "Touches":
        """Return the touches of some rows, without bars of which only one end is touched in the selected rows."""
        body = self.body[rows]
        ends = np.bincount(body[body >= 0], minlength=len(self.bodies))
        half = [i for i, b in enumerate(self.bodies) if b.is_bar and ends[i] == 1]
        body = np.where(np.isin(body, half), -1, body)
        there, code = np.unique(body[body >= 0], return_inverse=True)
        body[body >= 0] = code
        return Touches(self.name, tuple(self.bodies[i] for i in there), body, self.feature[rows])

    def residual(self, tips: Tips, own: Own) -> Array:
        out = np.full(self.readings.shape, np.nan)
        if not self.bodies:
            return out
        seen = self._seen(tips, own)
        for shape, rows in self._rows:
            gap = shape.gap(seen.points[rows])
            gap[:, 0] -= seen.radius[rows]
            out[rows, : gap.shape[1]] = -gap
        return out

    def by_tip(self, tips: Tips, own: Own) -> Array:
        if not self.bodies:
            return np.zeros((*self.readings.shape, 6))
        seen = self._seen(tips, own)
        turn = np.swapaxes(seen.frames[:, :3, :3], 1, 2) @ np.swapaxes(tips.turn, 1, 2)
        along = self._slope(seen) @ turn
        return np.concatenate([along, np.zeros_like(along)], axis=2)

    def by_own(self, tips: Tips, own: Own) -> Array:
        out = np.zeros((*self.readings.shape, sum(map(len, self.own.values()))))
        if not self.bodies:
            return out
        seen = self._seen(tips, own)
        change = self._slope(seen) @ np.swapaxes(seen.within[:, :3, :3], 1, 2) @ by_pose(seen.in_body)
        touched = np.flatnonzero(self.body >= 0)
        first = np.cumsum([0, *(len(body.unknowns) for body in self.bodies)])[self.body[touched]]
        count = np.array([len(body.axes) for body in self.bodies])[self.body[touched]]
        axes = np.array([(*body.axes, *[0] * (6 - len(body.axes))) for body in self.bodies])[self.body[touched]]
        for k in range(int(count.max(initial=0))):
            rows = k < count
            at = touched[rows]
            out[at, :, first[rows] + k] = change[at, :, axes[rows, k]]
        sized = np.array([body.sized for body in self.bodies])[self.body[touched]]
        out[touched[sized], 0, first[sized] + count[sized]] = -1.0
        return out

    def moved(self, key: str, value: Array, step: Array) -> Array:
        """Return the pose of a touched body after a twist of its axes, and the sum of radius and step. The pose of a
        bar is unchanged, because it follows from the bar's touches."""
        body = self._by_name[key]
        if body.is_bar:
            return value
        twist = np.zeros(6)
        twist[list(body.axes)] = step[: len(body.axes)]
        return np.concatenate([turned(value, twist), value[6:] + step[len(body.axes) :]])

    @cached_property
    def _by_name(self) -> Mapping[str, Artefact]:
        return {body.name: body for body in self.bodies}

    def start(self, tips: Tips) -> Own:
        """Return initial poses of the touched bodies in closed form, or for several surfaces by least squares."""
        points = tips.root[:, :3, 3]
        return {body.name: self._placed(i, body, points) for i, body in enumerate(self.bodies)}

    def _placed(self, i: int, body: Artefact, points: Array) -> Array:
        mine = self.body == i
        if body.is_bar:
            return _laid(body, self.feature[mine], points[mine])
        if len(body.features) > 1:
            return _fitted(body, self.feature[mine], points[mine])
        only = body.features[0]
        if (count := int(mine.sum())) < only.shape.needs:
            raise InputError(f"{body.name}: {count} touches; the pose of the surface needs at least {only.shape.needs}")
        try:
            frame, radius = only.shape.place(points[mine], only.radius)
        except InputError as error:
            raise InputError(f"{body.name}: {error.said}") from None
        return np.concatenate([numbers_of(frame), [radius] if body.sized else []])

    def _slope(self, seen: "_Gaps") -> Array:
        out = np.zeros((*self.readings.shape, 3))
        for shape, rows in self._rows:
            slope = shape.slope(seen.points[rows])
            out[rows, : slope.shape[1]] = slope
        return out

    def _seen(self, tips: Tips, own: Own) -> "_Gaps":
        poses = self._poses(tips.root[:, :3, 3], own)
        sizes = [own[b.name][6] if b.sized else 0.0 for b in self.bodies]
        at, within, radius = self._features
        radius = radius[at] + np.array(sizes)[self.body]
        pose = poses[self.body]
        in_body = _into(pose, tips.root[:, :3, 3])
        return _Gaps(pose @ within[at], within[at], in_body, _into(within[at], in_body), radius)

    @cached_property
    def _features(self) -> tuple[IntArray, Array, Array]:
        """Index of each row's touched surface among the surfaces of all bodies; poses of the surfaces in the bodies, m;
        known radii, m."""
        flat = [f for body in self.bodies for f in body.features]
        first = np.cumsum([0, *(len(body.features) for body in self.bodies)])[:-1]
        at = np.where(self.body >= 0, first[self.body] + self.feature, 0)
        known = [0.0 if np.isnan(f.radius) else f.radius for f in flat]
        return at, np.array([f.frame for f in flat]), np.array(known)

    @cached_property
    def _bars(self) -> tuple[IntArray, IntArray, Array]:
        """Numbers of the touched bars, the rows (bars, 2) of their ends, and half of their lengths, m."""
        bars = np.array([i for i, body in enumerate(self.bodies) if body.is_bar], dtype=np.int64)
        rows = np.full((len(self.bodies), 2), -1)
        touched = np.flatnonzero(self.body >= 0)
        rows[self.body[touched], np.minimum(self.feature[touched], 1)] = touched
        return bars, rows[bars], np.array([0.5 * self.bodies[i].features[1].frame[2, 3] for i in bars])

    def _poses(self, points: Array, own: Own) -> Array:
        """Return the poses (bodies, 4, 4) of touched bodies. A bar is on the line of its touches, in their middle."""
        numbers = np.array([own[body.name][:6] for body in self.bodies])
        poses = se3.exp(np.concatenate([np.zeros((len(numbers), 3)), numbers[:, 3:]], axis=1))
        poses[:, :3, 3] = numbers[:, :3]
        bars, ends, half = self._bars
        if len(bars):
            start, along = points[ends[:, 0]], points[ends[:, 1]] - points[ends[:, 0]]
            size = np.linalg.norm(along, axis=1, keepdims=True)
            along = np.where(size > 0, along / np.where(size > 0, size, 1.0), poses[bars, :3, 2])
            poses[bars] = aligned(start + (0.5 * size - half[:, None]) * along, along)
        return poses


@dataclass(frozen=True)
class _Gaps:
    """Geometry of each touch. frames, within: pose of the touched surface in the root and in its body. in_body, points:
    tool point (3,) in the body and in the surface's frame, m. radius: radius, m."""

    frames: Array
    within: Array
    in_body: Array
    points: Array
    radius: Array


def _into(frames: Array, points: Array) -> Array:
    return np.asarray(np.einsum("nji,nj->ni", frames[:, :3, :3], points - frames[:, :3, 3]))


def _laid(body: Artefact, feature: IntArray, points: Array) -> Array:
    """Return the six pose parameters of a bar whose middle is between the two touches."""
    first, second = (points[feature == k].mean(axis=0) if (feature == k).any() else points[0] for k in (0, 1))
    along, length = second - first, body.features[1].frame[2, 3]
    along = along / np.linalg.norm(along) if np.any(along) else np.array([0.0, 0.0, 1.0])
    return numbers_of(aligned(0.5 * (first + second) - 0.5 * length * along, along))


def _fitted(body: Artefact, feature: IntArray, points: Array) -> Array:
    """Fit the six pose parameters of a body with several touched surfaces, starting from each of the 24 rotations of a
    cube."""
    kinds = [(f, points[feature == k]) for k, f in enumerate(body.features) if (feature == k).any()]
    middle = points.mean(axis=0)

    def misfit(step: Array, about: Array) -> Array:
        pose = frame_of(about) @ frame_of(step)
        gaps = []
        for f, touched in kinds:
            frame = pose @ f.frame
            gap = f.shape.gap((touched - frame[:3, 3]) @ frame[:3, :3])
            gap[:, 0] -= f.radius
            gaps.append(gap.ravel())
        return np.concatenate(gaps)

    inside = np.mean([f.frame[:3, 3] for f, _ in kinds], axis=0)
    best = None
    for turn in Rotation.create_group("O"):
        about = np.concatenate([middle - turn.apply(inside), turn.as_rotvec()])
        found = scipy.optimize.least_squares(misfit, np.zeros(6), args=(about,), max_nfev=40)
        if best is None or found.cost < best[0]:
            best = found.cost, numbers_of(frame_of(about) @ frame_of(found.x))
    assert best is not None
    return best[1]
