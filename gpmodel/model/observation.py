"""What an instrument reads of a pose: a point, an orientation, a distance, or anything with the same few answers."""

from dataclasses import dataclass, field
from typing import Protocol, cast

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.errors import InputError
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class Tips:
    """Predicted tip poses (N, 4, 4), m: in the mechanism's root frame, and in the instrument's."""

    root: Array
    instrument: Array

    @property
    def turn(self) -> Array:
        """Rotations (N, 3, 3) from the axes of the root frame to those of the instrument."""
        return self.instrument[:, :3, :3] @ np.swapaxes(self.root[:, :3, :3], 1, 2)


class Observation(Protocol):
    """One kind of reading: m components at each of N poses, NaN where unmeasured, and what moves them.

    name: of its own unknowns and in messages. unit: of its components, "m" or "rad". absolute: it reads in the
    instrument's frame, so that the registration moves it. oriented: a turn of the tool about its point moves it.
    own: names (k) of what it has to find of itself, such as the place of its anchor.
    """

    @property
    def name(self) -> str:
        """What the table calls it."""
        ...

    @property
    def unit(self) -> str:
        """Unit of its readings."""
        ...

    @property
    def components(self) -> int:
        """Numbers a reading has."""
        ...

    @property
    def absolute(self) -> bool:
        """Whether it places the mechanism in the instrument's frame."""
        ...

    @property
    def oriented(self) -> bool:
        """Whether it says how the tool is turned."""
        ...

    @property
    def own(self) -> tuple[str, ...]:
        """Names of its own unknowns."""
        ...

    def subset(self, rows: IntArray) -> "Observation":
        """The same readings at some poses only."""
        ...

    def predict(self, tips: Tips, own: Array) -> Array:
        """What it would read (N, m)."""
        ...

    def residual(self, tips: Tips, own: Array) -> Array:
        """Measured minus predicted (N, m), NaN where unmeasured."""
        ...

    def by_tip(self, tips: Tips, own: Array) -> Array:
        """Change (N, m, 6) per unit motion of the tip: of its point, m, and a turn about it, rad, in the
        instrument's axes."""
        ...

    def by_own(self, tips: Tips, own: Array) -> Array:
        """Change (N, m, k) per unit of its own unknowns."""
        ...

    def start(self, tips: Tips) -> Array:
        """Its own unknowns (k,) to start from. Raises InputError where too little was measured for them."""
        ...


@dataclass(frozen=True)
class Point:
    """The tip's position in the instrument's frame: values (N, 3), m."""

    values: Array
    name: str = field(default="position", init=False)
    unit: str = field(default="m", init=False)
    components: int = field(default=3, init=False)
    oriented: bool = field(default=False, init=False)
    own: tuple[str, ...] = field(default=(), init=False)

    @property
    def absolute(self) -> bool:
        """Whether it places the mechanism in the instrument's frame."""
        return bool(np.isfinite(self.values).any())

    def subset(self, rows: IntArray) -> "Point":
        return Point(self.values[rows])

    def predict(self, tips: Tips, own: Array) -> Array:
        return tips.instrument[:, :3, 3]

    def residual(self, tips: Tips, own: Array) -> Array:
        return self.values - self.predict(tips, own)

    def by_tip(self, tips: Tips, own: Array) -> Array:
        return np.broadcast_to(np.eye(6)[:3], (len(self.values), 3, 6))

    def by_own(self, tips: Tips, own: Array) -> Array:
        return np.zeros((len(self.values), 3, 0))

    def start(self, tips: Tips) -> Array:
        return np.zeros(0)


@dataclass(frozen=True)
class Orientation:
    """The tip's orientation in the instrument's frame: rotation vectors values (N, 3), rad.

    The residual is the rotation vector of R_measured R_predictedᵀ.
    """

    values: Array
    name: str = field(default="rotation", init=False)
    unit: str = field(default="rad", init=False)
    components: int = field(default=3, init=False)
    own: tuple[str, ...] = field(default=(), init=False)

    @property
    def absolute(self) -> bool:
        """Whether it places the mechanism in the instrument's frame."""
        return bool(np.isfinite(self.values).any())

    @property
    def oriented(self) -> bool:
        """Whether it says how the tool is turned."""
        return self.absolute

    def subset(self, rows: IntArray) -> "Orientation":
        return Orientation(self.values[rows])

    def predict(self, tips: Tips, own: Array) -> Array:
        return se3.rotation_vector(tips.instrument[:, :3, :3])

    def residual(self, tips: Tips, own: Array) -> Array:
        out = np.full(self.values.shape, np.nan)
        rows = np.isfinite(self.values).all(axis=1)
        if rows.any():
            measured = se3.exp(np.hstack([np.zeros((rows.sum(), 3)), self.values[rows]]))[:, :3, :3]
            out[rows] = se3.rotation_vector(measured @ np.swapaxes(tips.instrument[rows, :3, :3], 1, 2))
        return out

    def by_tip(self, tips: Tips, own: Array) -> Array:
        return np.broadcast_to(np.eye(6)[3:], (len(self.values), 3, 6))

    def by_own(self, tips: Tips, own: Array) -> Array:
        return np.zeros((len(self.values), 3, 0))

    def start(self, tips: Tips) -> Array:
        return np.zeros(0)


@dataclass(frozen=True)
class Distance:
    """The tip's distance from an anchor that is fixed to the mechanism's root: values (N,), m.

    Its own unknown is the anchor's place (3,) in the root frame, m.
    """

    name: str
    values: Array
    unit: str = field(default="m", init=False)
    components: int = field(default=1, init=False)
    absolute: bool = field(default=False, init=False)
    oriented: bool = field(default=False, init=False)
    own: tuple[str, ...] = field(default=("anchor x", "anchor y", "anchor z"), init=False)

    def subset(self, rows: IntArray) -> "Distance":
        return Distance(self.name, self.values[rows])

    def predict(self, tips: Tips, own: Array) -> Array:
        return np.linalg.norm(tips.root[:, :3, 3] - own, axis=1)[:, None]

    def residual(self, tips: Tips, own: Array) -> Array:
        return self.values[:, None] - self.predict(tips, own)

    def by_tip(self, tips: Tips, own: Array) -> Array:
        along = -self.by_own(tips, own) @ np.swapaxes(tips.turn, 1, 2)
        return np.concatenate([along, np.zeros_like(along)], axis=2)

    def by_own(self, tips: Tips, own: Array) -> Array:
        return ((own - tips.root[:, :3, 3]) / self.predict(tips, own))[:, None, :]

    def start(self, tips: Tips) -> Array:
        """By trilateration, linear in a and |a|²: d² = |p|² - 2 p·a + |a|²."""
        seen = np.isfinite(self.values)
        if seen.sum() < 4:
            raise InputError(f"column '{self.name}': {int(seen.sum())} distances; its anchor needs at least 4")
        points = tips.root[seen, :3, 3]
        system = np.column_stack([-2 * points, np.ones(len(points))])
        return np.linalg.lstsq(system, self.values[seen] ** 2 - np.sum(points**2, axis=1), rcond=None)[0][:3]


def observations(dataset: Dataset) -> tuple[Observation, ...]:
    """Everything read at the poses of a dataset: point, orientation, distances, then what else it carries."""
    distances = (Distance(name, values) for name, values in dataset.distances.items())
    more = (cast(Observation, o) for o in dataset.observations)
    return (Point(dataset.position), Orientation(dataset.rotation), *distances, *more)
