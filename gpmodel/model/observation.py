"""Observations: measurements of points, orientations, distances and other kinds, with one interface."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol, cast

import numpy as np

from gpmodel.arrays import Array, IntArray, Mask
from gpmodel.errors import InputError
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset


@dataclass(frozen=True)
class Tips:
    """Predicted poses (poses, 4, 4) of the measured tip, m.

    root: poses in the root frame of the mechanism.
    instrument: poses in the frame of the instrument.
    slots: frames of the mechanism in the root frame, (frames, poses, 4, 4).
    """

    root: Array
    instrument: Array
    slots: Array

    @property
    def turn(self) -> Array:
        """Rotations (poses, 3, 3) from the axes of the root frame to the axes of the instrument frame."""
        return self.instrument[:, :3, :3] @ np.swapaxes(self.root[:, :3, :3], 1, 2)


METRES_A_RADIAN = 1.0
"""Length that counts as one radian, m: a lever of a metre."""
Weights = Mapping[str, float]
"""Length, m, with the noise of one unit of each kind of measurement, by name; by default Observation.metres."""
Own = Mapping[str, Array]
"""Unknowns of the measuring equipment by key, such as positions of fixed ends, surfaces and cameras."""


class Observation(Protocol):
    """Measurements of one kind, (poses, components), NaN if unmeasured, and their derivatives."""

    @property
    def name(self) -> str:
        """Unique name of the kind of measurement in the table and in messages."""

    @property
    def unit(self) -> str:
        """Unit of the measured components: "m", "rad" or "px"."""

    @property
    def metres(self) -> float:
        """Length, m, that counts as one unit of the measurement before the measurement's noise is estimated."""

    @property
    def components(self) -> int:
        """Number of components of one measurement, such as 3 for a point."""

    @property
    def absolute(self) -> bool:
        """True if the measurement is in the frame of the instrument and depends on the registration."""

    @property
    def oriented(self) -> bool:
        """True if the measurement depends on a rotation of the tool about its point."""

    @property
    def own(self) -> Mapping[str, tuple[str, ...]]:
        """Unknowns of the equipment as {key: names of the parameters}, in the order of the columns of `by_own`."""

    @property
    def kept(self) -> tuple[str, ...]:
        """Keys of the unknowns that remain valid in another measurement session: mountings on a link, and a lens."""

    @property
    def readings(self) -> Mask:
        """Mask of the measured components, (poses, components)."""

    def subset(self, rows: IntArray) -> "Observation":
        """Return the measurements at the poses with the given row numbers."""

    def residual(self, tips: Tips, own: Own) -> Array:
        """Return measured minus predicted values (poses, components), NaN if unmeasured."""

    def by_tip(self, tips: Tips, own: Own) -> Array:
        """Return derivatives (poses, components, 6) of the prediction with respect to the motion of the tip in
        instrument axes.

        The motion of the tip consists of the shift of its point, m, and a rotation about the point, rad.
        """

    def by_slots(self, tips: Tips, own: Own) -> Mapping[int, Array]:
        """Return {frame number: derivative of the prediction with respect to a motion of the frame}, in the axes of the
        root."""

    def by_own(self, tips: Tips, own: Own) -> Array:
        """Return derivatives (poses, components, unknowns) of the prediction with respect to unknowns of the measuring
        equipment."""

    def moved(self, key: str, value: Array, step: Array) -> Array:
        """Return the value of the unknown `key` of the measuring equipment after a step."""

    def start(self, tips: Tips) -> Own:
        """Return initial values of the equipment's unknowns; raise InputError if the data do not determine them."""


class OfTip:
    """Base class of measurements that depend on the frame of the tip alone."""

    kept: ClassVar[tuple[str, ...]] = ()
    unit: ClassVar[str] = "m"
    metres: ClassVar[float] = 1.0

    def by_slots(self, tips: Tips, own: Own) -> Mapping[int, Array]:
        """Return no derivatives: of all frames, only the frame of the tool's tip changes the measurement."""
        return {}

    def moved(self, key: str, value: Array, step: Array) -> Array:
        """Add a step to the value of an unknown of the measuring equipment."""
        return value + step


class WithoutUnknowns(OfTip):
    """Base class of measurements of the tip without unknowns other than registration and tool."""

    own: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    components: ClassVar[int] = 3
    values: Array

    @property
    def readings(self) -> Mask:
        """Mask of the measured components of positions or orientations along three axes, (poses, 3)."""
        return np.isfinite(self.values)

    @property
    def absolute(self) -> bool:
        """True if any component was measured, so that the measurements determine the registration."""
        return bool(self.readings.any())

    def by_own(self, tips: Tips, own: Own) -> Array:
        """Return an empty array, since positions and orientations add no unknowns to registration and tool."""
        return np.zeros((len(self.values), 3, 0))

    def start(self, tips: Tips) -> Own:
        """Return an empty mapping, since positions and orientations add no unknowns to registration and tool."""
        return {}


class OfLinks:
    """Base class of measurements of two components that depend on frames of links, not on the frame of the tip."""

    components: ClassVar[int] = 2
    absolute: ClassVar[bool] = False
    oriented: ClassVar[bool] = False
    values: Array

    @property
    def readings(self) -> Mask:
        """Mask of the measured components of pixels or inclinations, (poses, 2)."""
        return np.isfinite(self.values)

    def by_tip(self, tips: Tips, own: Own) -> Array:
        """Return derivatives of zero, since the tool point does not change measurements on links."""
        return np.zeros((len(self.values), 2, 6))


@dataclass(frozen=True)
class Point(WithoutUnknowns):
    """Position of the tip in the frame of the instrument: values (poses, 3), m."""

    values: Array
    name: ClassVar[str] = "position"
    oriented: ClassVar[bool] = False

    def subset(self, rows: IntArray) -> "Point":
        return Point(self.values[rows])

    def residual(self, tips: Tips, own: Own) -> Array:
        return self.values - tips.instrument[:, :3, 3]

    def by_tip(self, tips: Tips, own: Own) -> Array:
        return np.broadcast_to(np.eye(6)[:3], (len(self.values), 3, 6))


@dataclass(frozen=True)
class Orientation(WithoutUnknowns):
    """Orientation of the tip in the frame of the instrument: rotation vectors (poses, 3), rad.

    The residual is the rotation vector of R_measured R_predictedᵀ.
    """

    values: Array
    name: ClassVar[str] = "rotation"
    unit: ClassVar[str] = "rad"
    metres: ClassVar[float] = METRES_A_RADIAN

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
class Distance(OfTip):
    """Distance of the tip from a point fixed to the mechanism's root, plus a zero offset: one value per pose, m.

    The measured distance of a tip p is |p - a| + z, with the unknown position a (3,) of the fixed point in the root
    frame and the unknown zero offset z of the instrument, m. Source: Driels and Swayze (1994), "Automated partial pose
    measurement system for manipulator calibration experiments", IEEE T-RA 10.
    """

    name: str
    values: Array
    components: ClassVar[int] = 1
    absolute: ClassVar[bool] = False
    oriented: ClassVar[bool] = False

    @property
    def own(self) -> Mapping[str, tuple[str, ...]]:
        """The unknowns of a distance instrument: its fixed point and its zero offset."""
        return {self.name: ("anchor x", "anchor y", "anchor z", "zero")}

    @property
    def readings(self) -> Mask:
        """Mask of the measured distances, (poses, 1)."""
        return np.isfinite(self.values)[:, None]

    def subset(self, rows: IntArray) -> "Distance":
        return Distance(self.name, self.values[rows])

    def predict(self, tips: Tips, own: Own) -> Array:
        """Return the predicted distances (poses, 1), m."""
        *anchor, zero = own[self.name]
        return np.asarray(np.linalg.norm(tips.root[:, :3, 3] - anchor, axis=1)[:, None] + zero)

    def residual(self, tips: Tips, own: Own) -> Array:
        return self.values[:, None] - self.predict(tips, own)

    def by_tip(self, tips: Tips, own: Own) -> Array:
        along = -self.by_own(tips, own)[:, :, :3] @ np.swapaxes(tips.turn, 1, 2)
        return np.concatenate([along, np.zeros_like(along)], axis=2)

    def by_own(self, tips: Tips, own: Own) -> Array:
        away = own[self.name][:3] - tips.root[:, :3, 3]
        along = away / np.linalg.norm(away, axis=1, keepdims=True)
        return np.hstack([along, np.ones((len(away), 1))])[:, None, :]

    def start(self, tips: Tips) -> Own:
        """Return fixed point a and zero z by trilateration from tip positions p, linear in a, z and |a|² - z²:
        d² = |p|² - 2 p·a + 2 d z + |a|² - z²."""
        seen = np.isfinite(self.values)
        if seen.sum() < 5:
            raise InputError(f"column '{self.name}': {int(seen.sum())} distances; anchor and zero need at least 5")
        points, lengths = tips.root[seen, :3, 3], self.values[seen]
        system = np.column_stack([-2 * points, 2 * lengths, np.ones(len(points))])
        return {self.name: np.linalg.lstsq(system, lengths**2 - np.sum(points**2, axis=1))[0][:4]}


def weight_of(kind: Observation, weights: Weights) -> float:
    """Return the length, m, that counts as one unit of a kind of measurement, in a fit with the given weights."""
    return weights.get(kind.name, kind.metres)


def observations(dataset: Dataset) -> tuple[Observation, ...]:
    """Return all kinds of measurements of a table: point, orientation, distances, then the other kinds."""
    distances = (Distance(name, values) for name, values in dataset.distances.items())
    more = cast(tuple[Observation, ...], dataset.observations)
    return (Point(dataset.position), Orientation(dataset.rotation), *distances, *more)
