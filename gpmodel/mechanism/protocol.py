"""Interface of a mechanism: a chain of slots, and the loads in it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError

GRAVITY = 9.81
"""Acceleration of gravity at middle latitudes, m/s². Standard gravity is 9.80665, and the range on Earth 9.78 to 9.83:
loads and compliances are right to 0.3 %."""

SI = {"length": "m", "angle": "rad", "mass": "kg", "acceleration": "m/s**2", "pixels": "px"}
"""Units by dimension."""

LARGEST = {"length": 1e3, "angle": 1e3, "mass": 5e4, "acceleration": 1e2, "pixels": 1e5}
"""Largest accepted values, in SI: lengths, angles, masses, accelerations and pixels of every machine are smaller. A
larger one has a wrong unit."""


def checked(value: float, dimension: str, where: str) -> float:
    """A value in SI of a machine. Raises InputError naming `where` when it is beyond LARGEST or no number."""
    if not abs(value) <= LARGEST[dimension]:
        most = f"{LARGEST[dimension]:g} {SI[dimension]}"
        raise InputError(f"{where}: {value:g} {SI[dimension]}; expected at most {most}, the unit may be wrong")
    return value


def checked_mass(mass: float, where: str, argument: str = "") -> float:
    """A mass, kg. Raises InputError naming `where` when it is negative, beyond LARGEST or no number."""
    if not 0.0 <= mass <= LARGEST["mass"]:
        said = f"{where}: " if where else ""
        raise InputError(f"{said}{mass:g} kg; expected a mass from 0 to {LARGEST['mass']:g} kg", argument)
    return mass


AXES = ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz")


@dataclass(frozen=True)
class Joint:
    """One joint coordinate of the measured table.

    kind: "revolute" (SI unit rad) or "prismatic" (m). lower, upper: limits in SI, infinite where unknown.
    drive: what a small error of this coordinate moves, as (slot, axis, weight) terms. One term for a serial
    joint; two for an axis driven through a parallel bar. `measured` is False for a joint without a
    sensor, whose table values are approximate.
    """

    name: str
    kind: str
    lower: float
    upper: float
    drive: tuple[tuple[str, str, float], ...]
    measured: bool = True


@runtime_checkable
class Mechanism(Protocol):
    """A chain of nominal frames.

    The measured point is  T_register · T_0 E_0 · T_1(q) E_1 · ... · T_S(q) E_S · T_tool  with the error twists
    E_s = exp(twist) acting in the frame of slot s. Joint j has a slot on each side of its motion, `NAME.fixed`
    and `NAME.moving`; the first slot is `base`, the last is `tool` (the flange).
    """

    @property
    def name(self) -> str:
        """Name of the mechanism."""

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Its joints, in the order of the table's columns."""

    @property
    def slots(self) -> tuple[str, ...]:
        """The frames at which error twists act, from the base to the tool."""

    def transforms(self, q: Array) -> Array:
        """Nominal transforms (S, N, 4, 4) of each slot's frame in the frame of the slot before it (metres);
        the first is given in the mechanism's root frame. q: (N, n), rad and m, table coordinates."""

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Return the gravity loads on the mechanism at rest, by name, each (N,): the load itself, not its reaction.

        torque_J2 (Nm; N of a prismatic joint): generalised force on the coordinate J2, in table coordinates: minus the
        slope of the potential energy, positive where gravity pushes the coordinate up. With J2 counted positive
        upwards, a payload on a horizontal arm gives a negative torque; a joint that yields moves by compliance times
        torque.
        force_J2_x .. moment_J2_z (N, Nm): wrench that the weight of everything beyond J2 exerts at the origin of
        J2.moving, in its axes; force_base_x .. moment_base_z likewise of the whole, in the frame of the base. A
        weight points along gravity. Names use the joints' names. payload: (N,) kg carried at the tool.
        Empty where no masses are known and payload is zero.
        """


@runtime_checkable
class ClosedLoops(Protocol):
    """A mechanism whose legs meet again in one platform: an error in a leg moves the tool as the other legs allow.

    Its slots are listed one after the other like those of a chain, and `transforms` leads from each to the next; only
    what an error does is another. The standard model of a chain does not fit it, so that it states its own.
    """

    @property
    def constants(self) -> tuple[tuple[str, str], ...]:
        """(slot, axis) of every constant of its complete geometry."""

    def assembled(self, q: Array, twists: Mapping[int, Array]) -> Array:
        """Frames (S, N, 4, 4) of the slots in the root, m, each after its own error twist, with all loops closed.

        q: (N, n) table coordinates. twists: a slot's index -> (N, 6), m and rad. Raises InputError where they do not
        close.
        """

    def closes(self, q: Array, twists: Mapping[int, Array] | None = None) -> Mask:
        """Return whether the loops close (N,) with the error twists of `assembled`, nominally without.

        q: (N, n) table coordinates.
        """

    def carried(self, frames: Array, slot: int) -> Array:
        """Twist of the slot `tool` in its own frame per unit twist at a slot, (N, 6, 6), by implicit differentiation.

        frames: (S, N, 4, 4) of a closed mechanism in any common frame. A twist acts in a slot's frame as it is there.
        """


def closed(mechanism: Mechanism) -> ClosedLoops | None:
    """Return the mechanism with closed loops, or the one inside; None for a chain."""
    bare = bare_of(mechanism)
    return bare if isinstance(bare, ClosedLoops) else None


INSTRUMENT = "instrument"
"""Where the instrument's own errors act: a twist in the frame of its readings, before they are registered."""


def places(mechanism: Mechanism) -> tuple[str, ...]:
    """Where an error twist may act: the slots of the mechanism, and the instrument after them."""
    return (*mechanism.slots, INSTRUMENT)


@runtime_checkable
class Weighed(Protocol):
    """A mechanism that also says how each of its parts weighs on its joints. Gravity's loads at rest are linear in the
    masses and first moments of mass (kg·m), so that they can be unknowns."""

    def unit_loads(self, q: Array) -> dict[str, Array]:
        """Parts of the static loads by name, each (N,); those that are zero throughout are left out.

        torque_J2_of_J4_x: torque about the coordinate J2 of a first moment of mass of 1 kg·m along x of J4.moving,
        carried by the link beyond J4; moment_base_x_of_J4_x: likewise about the base. Every arm's gravity torque about
        a turning joint is a combination of these whatever its masses. torque_J2_of_J4: torque of the weight that the
        description gives the link beyond J4. Source: Khalil and Dombre 2002, ch. 9.
        """


@runtime_checkable
class Wrapping(Protocol):
    """A mechanism around another, which it was loaded as."""

    @property
    def bare(self) -> Mechanism:
        """The mechanism inside."""


def followers(mechanism: Mechanism) -> dict[str, str]:
    """Find the joints that move with another one alone, as a mimic joint does: their name -> that of the other."""
    own = {joint.name for joint in mechanism.joints}
    drives = {slot.removesuffix(".moving"): joint.name for joint in mechanism.joints for slot, _, _ in joint.drive}
    return {name: leader for name, leader in drives.items() if name not in own}


@runtime_checkable
class Described(Protocol):
    """A mechanism that knows what of its description is not read."""

    @property
    def not_read(self) -> tuple[str, ...]:
        """Parts of the description that are ignored, each with its location."""


def bare_of(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism that the provider built."""
    return mechanism.bare if isinstance(mechanism, Wrapping) else mechanism


@runtime_checkable
class Levered(Protocol):
    """A mechanism that says itself which lengths grow with temperature."""

    @property
    def levers(self) -> dict[str, Array]:
        """Slot -> the vector (3,), m, from the slot before to it, in its own frame."""


@runtime_checkable
class Reaching(Protocol):
    """A mechanism whose lever a first fit finds, because its nominal description has none."""

    def reaching(self, point: Iterable[float]) -> Mechanism:
        """Return the mechanism with the tool at `point` (3,), m, in the measured frame."""


@runtime_checkable
class Massive(Protocol):
    """A mechanism whose masses are known one by one."""

    @property
    def bodies(self) -> Mapping[str, tuple[float, Array]]:
        """Slot -> mass, kg, and its centre (3,) in the frame of the slot, m; those without mass are left out."""

    @property
    def gravity(self) -> Array:
        """(3,) m/s² in the root frame."""

    @property
    def payload_com(self) -> Array:
        """(3,) m in the measured frame."""


@runtime_checkable
class Collides(Protocol):
    """A mechanism that may know where its parts are."""

    @property
    def has_shape(self) -> bool:
        """True if the shape is known; without it the mechanism never collides and never hides anything."""

    def collides(self, q: Array) -> Mask:
        """Return where the mechanism collides with itself (N,) at q (N, n), rad and m."""

    def hides(self, q: Array, points: Array, instrument: Array) -> Mask:
        """Return where a part blocks the line (N,) from points (N, 3) to the instrument (3,), m, in the root frame."""


@runtime_checkable
class ExportsUrdf(Protocol):
    """A mechanism that can write itself, with constant errors in it, as URDF."""

    def write_urdf(self, path: Path, twists: Mapping[str, Array] | None = None) -> str:
        """Write the chain with a constant error twist (6,), m and rad, at some slots; returns the link to measure at.
        Raises InputError for a slot the mechanism does not have, or a file that cannot be written."""


Shift = tuple[tuple[str, str, float], ...]
"""(slot, axis, weight) terms of a shift of a ball's centre by one metre."""


@dataclass(frozen=True)
class Ball:
    """A ball in its socket.

    name: empty where a mechanism has but one. angles: columns of States, rad, by which it turns in its socket, about
    the socket's x, then its own y, then z. shifts: of its centre, by the direction in words, that along its lever or
    leg last. axial: the name of the load on it along its leg, N, positive where it pulls; empty without one.
    """

    name: str
    angles: tuple[str, ...]
    shifts: Mapping[str, Shift]
    axial: str = ""

    @property
    def along(self) -> tuple[str, Shift]:
        """The direction of its lever or leg in words, and the shift."""
        return list(self.shifts.items())[-1]

    @property
    def suffix(self) -> str:
        """Suffix that distinguishes an effect of this ball from that of another ball of the machine."""
        return f", {self.name}" if self.name else ""


@runtime_checkable
class BallJointed(Protocol):
    """A mechanism with ball joints, whose angles nothing reads."""

    @property
    def balls(self) -> tuple[Ball, ...]:
        """Its balls, from the base on."""

    def turned(self, q: Array) -> dict[str, Array]:
        """Angles (N,) of its balls, rad, that are no joint coordinates of the table, at nominal geometry; q: (N, n)."""


def ball_jointed(mechanism: Mechanism) -> BallJointed | None:
    """The mechanism, or what it was loaded from, where it has ball joints."""
    bare = bare_of(mechanism)
    return bare if isinstance(bare, BallJointed) else None


def balls_of(mechanism: Mechanism) -> tuple[Ball, ...]:
    """The balls of a mechanism; none of one without."""
    jointed = ball_jointed(mechanism)
    return jointed.balls if jointed else ()
