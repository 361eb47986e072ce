"""Readings of an instrument at a pose: a point, an orientation, a distance, or any other kind with the same
interface.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Protocol, cast

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class Tips:
    """Predicted tip poses (N, 4, 4), m: in the mechanism's root frame, and in the instrument's. slots: (S, N, 4, 4),
    the frames of the slots in the root frame."""

    root: Array
    instrument: Array
    slots: Array

    @property
    def turn(self) -> Array:
        """Rotations (N, 3, 3) from the axes of the root frame to those of the instrument."""
        return self.instrument[:, :3, :3] @ np.swapaxes(self.root[:, :3, :3], 1, 2)


Own = Mapping[str, Array]
"""Unknowns of the observations by key: positions of anchors, surfaces, cameras."""


class Observation(Protocol):
    """One kind of reading: m components at each of N poses, NaN where unmeasured, and what moves them.
    name: in messages, no other has the same. unit: of its components, "m", "rad" or "px". metres: that one such unit
    counts as; None of a rotation, whose weight the fit finds. absolute: it reads in the instrument's frame, so that the
    registration moves it. oriented: a turn of the tool about its point moves it.
    own: key of something it has to find -> names of the numbers a step of it has.
    """

    @property
    def name(self) -> str:
        """Name in the table."""

    @property
    def unit(self) -> str:
        """Unit of its readings."""

    @property
    def metres(self) -> float | None:
        """Metres that one unit counts as."""

    @property
    def components(self) -> int:
        """Numbers a reading has."""

    @property
    def absolute(self) -> bool:
        """True if the reading places the mechanism in the instrument's frame."""

    @property
    def oriented(self) -> bool:
        """True if the orientation of the tool was measured."""

    @property
    def own(self) -> Mapping[str, tuple[str, ...]]:
        """Names of its own unknowns, in the order of the columns of `by_own`."""

    @property
    def kept(self) -> tuple[str, ...]:
        """Keys of the unknowns that outlast a session: where a link carries something, and a lens."""

    @property
    def readings(self) -> Mask:
        """Measured components (N, m), True where measured."""

    def subset(self, rows: IntArray) -> "Observation":
        """Return the readings at some poses."""

    def residual(self, tips: Tips, own: Own) -> Array:
        """Measured minus predicted (N, m), NaN where unmeasured."""

    def by_tip(self, tips: Tips, own: Own) -> Array:
        """Change (N, m, 6) of what is predicted per unit motion of the tip: of its point, m, and a turn about it, rad,
        in the instrument's axes."""

    def by_slots(self, tips: Tips, own: Own) -> Mapping[int, Array]:
        """Return the sensitivity to a unit motion of the frame of each slot, by slot index, in the root's axes."""

    def by_own(self, tips: Tips, own: Own) -> Array:
        """Return the sensitivity (N, m, k) to a unit step of the observation's unknowns."""

    def moved(self, key: str, value: Array, step: Array) -> Array:
        """One of its own unknowns after a step (k,)."""

    def start(self, tips: Tips) -> Own:
        """Its own unknowns to start from. Raises InputError where too little was measured for them."""


class AtTheTip:
    """Observation that only the frame of the tip moves; no unknowns of other kinds are added."""

    kept: ClassVar[tuple[str, ...]] = ()

    def by_slots(self, tips: Tips, own: Own) -> Mapping[int, Array]:
        """None."""
        return {}

    def moved(self, key: str, value: Array, step: Array) -> Array:
        """The sum."""
        return value + step


class NothingOwn(AtTheTip):
    """Observation of a frame that registration and tool place, without unknowns."""

    own: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    values: Array

    @property
    def readings(self) -> Mask:
        """Measured components (N, 3), True where finite."""
        return np.isfinite(self.values)

    @property
    def absolute(self) -> bool:
        """True if anything was measured: the reading places the mechanism in the instrument's frame."""
        return bool(self.readings.any())

    def by_own(self, tips: Tips, own: Own) -> Array:
        """None."""
        return np.zeros((len(self.values), 3, 0))

    def start(self, tips: Tips) -> Own:
        """Nothing."""
        return {}


@dataclass(frozen=True)
class Point(NothingOwn):
    """The tip's position in the instrument's frame: values (N, 3), m."""

    values: Array
    name: str = field(default="position", init=False)
    unit: str = field(default="m", init=False)
    metres: float = field(default=1.0, init=False)
    components: int = field(default=3, init=False)
    oriented: bool = field(default=False, init=False)

    def subset(self, rows: IntArray) -> "Point":
        return Point(self.values[rows])

    def residual(self, tips: Tips, own: Own) -> Array:
        return self.values - tips.instrument[:, :3, 3]

    def by_tip(self, tips: Tips, own: Own) -> Array:
        return np.broadcast_to(np.eye(6)[:3], (len(self.values), 3, 6))


@dataclass(frozen=True)
class Orientation(NothingOwn):
    """The tip's orientation in the instrument's frame: rotation vectors values (N, 3), rad.

    The residual is the rotation vector of R_measured R_predictedᵀ.
    """

    values: Array
    name: str = field(default="rotation", init=False)
    unit: str = field(default="rad", init=False)
    metres: None = field(default=None, init=False)
    components: int = field(default=3, init=False)

    @property
    def oriented(self) -> bool:
        """True if the orientation of the tool was measured."""
        return self.absolute

    def subset(self, rows: IntArray) -> "Orientation":
        return Orientation(self.values[rows])

    def residual(self, tips: Tips, own: Own) -> Array:
        out = np.full(self.values.shape, np.nan)
        rows = np.isfinite(self.values).all(axis=1)
        if rows.any():
            measured = se3.exp(np.hstack([np.zeros((rows.sum(), 3)), self.values[rows]]))[:, :3, :3]
            out[rows] = se3.rotation_vector(measured @ np.swapaxes(tips.instrument[rows, :3, :3], 1, 2))
        return out

    def by_tip(self, tips: Tips, own: Own) -> Array:
        return np.broadcast_to(np.eye(6)[3:], (len(self.values), 3, 6))


@dataclass(frozen=True)
class Distance(AtTheTip):
    """The tip's distance from an anchor that is fixed to the mechanism's root: values (N,), m.

    Its own unknown is the anchor's place (3,) in the root frame, m.
    """

    name: str
    values: Array
    unit: str = field(default="m", init=False)
    metres: float = field(default=1.0, init=False)
    components: int = field(default=1, init=False)
    absolute: bool = field(default=False, init=False)
    oriented: bool = field(default=False, init=False)

    @property
    def own(self) -> Mapping[str, tuple[str, ...]]:
        """Its anchor."""
        return {self.name: ("anchor x", "anchor y", "anchor z")}

    @property
    def readings(self) -> Mask:
        """Measured rows (N, 1), True where finite."""
        return np.isfinite(self.values)[:, None]

    def subset(self, rows: IntArray) -> "Distance":
        return Distance(self.name, self.values[rows])

    def predict(self, tips: Tips, own: Own) -> Array:
        """Predict the distance (N, 1), m."""
        return np.asarray(np.linalg.norm(tips.root[:, :3, 3] - own[self.name], axis=1)[:, None])

    def residual(self, tips: Tips, own: Own) -> Array:
        return self.values[:, None] - self.predict(tips, own)

    def by_tip(self, tips: Tips, own: Own) -> Array:
        along = -self.by_own(tips, own) @ np.swapaxes(tips.turn, 1, 2)
        return np.concatenate([along, np.zeros_like(along)], axis=2)

    def by_own(self, tips: Tips, own: Own) -> Array:
        return ((own[self.name] - tips.root[:, :3, 3]) / self.predict(tips, own))[:, None, :]

    def start(self, tips: Tips) -> Own:
        """By trilateration, linear in a and |a|²: d² = |p|² - 2 p·a + |a|²."""
        seen = np.isfinite(self.values)
        if seen.sum() < 4:
            raise InputError(f"column '{self.name}': {int(seen.sum())} distances; its anchor needs at least 4")
        points = tips.root[seen, :3, 3]
        system = np.column_stack([-2 * points, np.ones(len(points))])
        return {self.name: np.linalg.lstsq(system, self.values[seen] ** 2 - np.sum(points**2, axis=1))[0][:3]}


def observations(dataset: Dataset) -> tuple[Observation, ...]:
    """Everything read at the poses of a dataset: point, orientation, distances, then what else it carries."""
    distances = (Distance(name, values) for name, values in dataset.distances.items())
    more = cast(tuple[Observation, ...], dataset.observations)
    return (Point(dataset.position), Orientation(dataset.rotation), *distances, *more)
