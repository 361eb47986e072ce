"""Interfaces of a mechanism: its slots (frames), its loads, and properties that only some mechanisms have."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError

GRAVITY = 9.81
"""Acceleration of gravity at middle latitudes, m/s². Standard gravity is 9.80665, and the range on Earth 9.78 to 9.83:
loads and compliances are correct to 0.3 %."""

SI = {"length": "m", "angle": "rad", "mass": "kg", "acceleration": "m/s**2", "pixels": "px"}
"""SI unit of each physical dimension, such as length."""

LARGEST = {"length": 1e3, "angle": 1e3, "mass": 5e4, "acceleration": 1e2, "pixels": 1e5}
"""Largest accepted lengths, angles, masses, accelerations and pixels, SI; a larger value has a wrong unit."""


def checked(value: float, dimension: str, where: str) -> float:
    """Return a value in SI units. Raises InputError naming `where` if the value is beyond LARGEST or not a number."""
    if not abs(value) <= LARGEST[dimension]:
        most = f"{LARGEST[dimension]:g} {SI[dimension]}"
        raise InputError(f"{where}: {value:g} {SI[dimension]}; expected at most {most}, the unit may be wrong")
    return value


def checked_mass(mass: float, where: str, argument: str = "") -> float:
    """Return a mass, kg. Raises InputError naming `where` if the mass is negative, beyond LARGEST or not a number."""
    if not 0.0 <= mass <= LARGEST["mass"]:
        message = f"{where}: " if where else ""
        raise InputError(f"{message}{mass:g} kg; expected a mass from 0 to {LARGEST['mass']:g} kg", argument)
    return mass


AXES = ("Tx", "Ty", "Tz", "Rx", "Ry", "Rz")


@dataclass(frozen=True)
class Joint:
    """One joint coordinate of the measured table.

    kind: "revolute" (rad) or "prismatic" (m).
    lower, upper: limits in rad or m, infinite if unknown.
    drive: (slot, axis, weight) of each twist that a unit error of the coordinate causes. The drive of a serial joint
    has one term, the drive of an axis with a parallel bar two.
    measured: False for a joint without a sensor, whose table values are approximate.
    """

    name: str
    kind: str
    lower: float
    upper: float
    drive: tuple[tuple[str, str, float], ...]
    measured: bool = True


@runtime_checkable
class Mechanism(Protocol):
    """Interface of a mechanism: a chain of nominal frames.

    Measured point: T_register · T_0 E_0 · T_1(q) E_1 · ... · T_S(q) E_S · T_tool, with nominal transforms T_s and error
    twists E_s = exp(twist) in the frame of slot s. Joint j has a frame (slot) on each side of its motion, `NAME.fixed`
    and `NAME.moving`; the first slot is `base`, the last slot is `tool` (the flange).
    """

    @property
    def name(self) -> str:
        """Name of the mechanism."""

    @property
    def joints(self) -> tuple[Joint, ...]:
        """The joints of the mechanism, in the order of the columns of the table."""

    @property
    def slots(self) -> tuple[str, ...]:
        """Names of the frames at which error twists act, from the base to the tool."""

    def transforms(self, q: Array) -> Array:
        """Return the nominal transforms (slots, poses, 4, 4), m, of each slot in the frame of the previous slot.

        The first slot's transform is in the root frame. q: joint values (poses, joints) of the table, rad and m.
        """

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Return the gravity loads on the mechanism at rest, by name, one value per pose: loads, not reactions.

        torque_J2 (Nm; N for a prismatic joint): generalised force on the coordinate J2 of the table, minus the
        derivative of the potential energy. The torque is positive where gravity increases the coordinate. If J2 is
        positive upwards, a payload on a horizontal arm gives a negative torque. A compliant joint moves by compliance
        times torque.

        force_J2_x .. moment_J2_z (N, Nm): wrench of the weight of everything beyond J2, in the frame J2.moving.
        force_base_x .. moment_base_z: wrench of the weight of the whole mechanism, in the frame of the base.

        Names contain the names of the joints. payload: mass at the tool at each pose, kg. No loads are returned if no
        masses are known and the payload is zero.
        """


@runtime_checkable
class ClosedLoops(Protocol):
    """A mechanism whose legs meet in one platform. An error in a leg moves the tool only as the other legs allow.

    `slots` (frames) and `transforms` are defined as for a serial chain; an error twist moves the tool differently. The
    geometric constants of a chain do not fit a mechanism with closed loops, which therefore states its own constants.
    """

    @property
    def constants(self) -> tuple[tuple[str, str], ...]:
        """Slot (frame) and axis of every geometric constant of the complete geometry."""

    def assembled(self, q: Array, twists: Mapping[int, Array]) -> Array:
        """Return poses (slots, poses, 4, 4) in the root frame, m, each after its error twist, with all loops closed.

        q: joint values (poses, joints). twists: {position of a frame (slot): error twists (poses, 6), m and rad}.
        Raises InputError if the loops do not close.
        """

    def closes(self, q: Array, twists: Mapping[int, Array] | None = None) -> Mask:
        """Return for each pose whether kinematic loops close, with the error twists `twists` or without errors.

        q: joint values (poses, joints) of the table.
        """

    def carried(self, frames: Array, slot: int) -> Array:
        """Return the twist (poses, 6, 6) of the slot `tool` per unit twist at another frame, by implicit derivatives.

        frames: poses (slots, poses, 4, 4) of all slots in any common frame. The twists are in the axes of their frames.
        """


def closed(mechanism: Mechanism) -> ClosedLoops | None:
    """Return the mechanism, or the mechanism inside a loaded mechanism, if it has closed loops, else None."""
    bare = unwrapped(mechanism)
    return bare if isinstance(bare, ClosedLoops) else None


INSTRUMENT = "instrument"
"""Name of the slot for errors of the instrument: a twist in the frame of its measurements, before registration."""


def places(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the names at which an error twist may act: the frames (slots) of the mechanism, then the instrument."""
    return (*mechanism.slots, INSTRUMENT)


@runtime_checkable
class WeightByPart(Protocol):
    """A mechanism that states the weight of each part separately.

    Static gravity loads are linear in masses and first moments of mass (kg·m), which can therefore be unknowns.
    """

    def unit_loads(self, q: Array) -> dict[str, Array]:
        """Return parts of the static loads by name, one value per pose, without parts that are zero everywhere.

        torque_J2_of_J4_x: torque about the coordinate J2 of a first moment of mass of 1 kg·m along x of J4.moving,
        carried by the link beyond J4. moment_base_x_of_J4_x: moment of this first moment about the base. The gravity
        torque about a revolute joint is a linear combination of these torques, one for each first moment of mass.
        torque_J2_of_J4: torque of the nominal weight of the link beyond J4. Source: Khalil and Dombre 2002, chapter 9.
        """


@runtime_checkable
class Wrapping(Protocol):
    """A mechanism that contains another mechanism and the name and options from which it was loaded."""

    @property
    def bare(self) -> Mechanism:
        """Mechanism without the name and options from which it was loaded."""


def followers(mechanism: Mechanism) -> dict[str, str]:
    """Return {joint: leading joint} of the joints that move with one other joint alone, such as mimic joints."""
    own = {joint.name for joint in mechanism.joints}
    drives = {slot.removesuffix(".moving"): joint.name for joint in mechanism.joints for slot, _, _ in joint.drive}
    return {name: leader for name, leader in drives.items() if name not in own}


@runtime_checkable
class WithIgnoredParts(Protocol):
    """A mechanism that lists the ignored parts of its description."""

    @property
    def not_read(self) -> tuple[str, ...]:
        """Ignored parts of the description, each with its location."""


def unwrapped(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism inside a loaded mechanism, as its provider built it."""
    return mechanism.bare if isinstance(mechanism, Wrapping) else mechanism


@runtime_checkable
class ThermalLevers(Protocol):
    """A mechanism that states which of its lengths grow with temperature."""

    @property
    def levers(self) -> dict[str, Array]:
        """{slot: vector (3,) [m] from the previous slot, in the frame of the slot}."""


@runtime_checkable
class FittedLever(Protocol):
    """A mechanism whose lever to the tool a first fit determines, because its nominal description has none."""

    def reaching(self, point: Iterable[float]) -> Mechanism:
        """Return the mechanism with the tool at `point` (3,), m, in the measured frame."""


@runtime_checkable
class KnownMasses(Protocol):
    """A mechanism that states the mass of each of its parts."""

    @property
    def bodies(self) -> Mapping[str, tuple[float, Array]]:
        """{slot: mass [kg] and centre of mass (3,) [m] in the frame of the slot}, without slots that have no mass."""

    @property
    def gravity(self) -> Array:
        """Acceleration of gravity (3,) in the root frame, m/s²."""

    @property
    def payload_com(self) -> Array:
        """Centre of mass (3,) of the payload in the measured frame, m."""


@runtime_checkable
class ChangeableLoads(KnownMasses, Protocol):
    """A mechanism whose gravity and masses can be changed."""

    def with_gravity(self, gravity: Array) -> Mechanism:
        """Return a copy of the mechanism with a new acceleration of gravity (3,) in the root frame, m/s²."""

    def with_mass(self, mass: float, moment: Array) -> Mechanism:
        """Return the mechanism with a further mass, kg, fixed to the measured frame.

        moment: first moment of the mass in the measured frame (mass times centre of mass), kg m.
        """


@runtime_checkable
class LoadsByTool(Protocol):
    """A mechanism whose tools may have different centres of mass."""

    def loads_by_tool(self, q: Array, payload: Array, tool: NDArray[np.str_]) -> dict[str, Array]:
        """Return the loads as Mechanism.loads, with the centre of mass of the tool of each pose.

        tool: label of the tool of each pose (poses,).
        """


@runtime_checkable
class CollisionShape(Protocol):
    """A mechanism that may know the shape of its parts."""

    @property
    def has_shape(self) -> bool:
        """True if the shape of the parts is known; unknown parts never collide and never block a line of sight."""

    def collides(self, q: Array) -> Mask:
        """Return for each row of joint values q (rad and m) whether the mechanism collides with itself."""

    def hides(self, q: Array, points: Array, instrument: Array) -> Mask:
        """Return for each pose whether a part blocks the line from a point of `points` (poses, 3) to the instrument
        (3,), in the root frame, m."""


@runtime_checkable
class ExportsUrdf(Protocol):
    """A mechanism that can be written as URDF, including constant errors of its geometry."""

    def write_urdf(self, path: Path, twists: Mapping[str, Array] | None = None) -> str:
        """Write the chain with a constant error twist (6,), m and rad, at some frames, and return the measured link.

        Raises InputError for an unknown frame (slot), or a file that cannot be written.
        """


Shift = tuple[tuple[str, str, float], ...]
"""Twists (slot, axis, weight) that together shift the centre of a ball by one metre."""


@dataclass(frozen=True)
class Ball:
    """A ball joint: a ball in its socket.

    name: name of the ball, empty if the mechanism has one.
    angles: columns of States, rad: rotations of the ball in its socket about the x axis of the socket, then about the y
    axis of the ball, then about its z axis.
    shifts: {direction in words: shift of the ball's centre}. The last direction is along the ball's lever or leg.
    axial: column of the load on the ball along its leg, N, positive for a pull; empty without a load.
    """

    name: str
    angles: tuple[str, ...]
    shifts: Mapping[str, Shift]
    axial: str = ""

    @property
    def along(self) -> tuple[str, Shift]:
        """The direction of the ball's lever or leg in words, and the shift along this direction."""
        return list(self.shifts.items())[-1]

    @property
    def suffix(self) -> str:
        """Text that distinguishes the names of effects of this ball from those of another ball of the machine."""
        return f", {self.name}" if self.name else ""


@runtime_checkable
class BallJointed(Protocol):
    """A mechanism with ball joints, whose angles are not measured."""

    @property
    def balls(self) -> tuple[Ball, ...]:
        """The ball joints of the mechanism, in order from the base."""

    def turned(self, q: Array) -> dict[str, Array]:
        """Return {angle: values, rad} of ball angles that are no joint coordinates, at joint values q."""


def ball_jointed(mechanism: Mechanism) -> BallJointed | None:
    """Return the mechanism, or the mechanism inside a loaded mechanism, if it has ball joints, else None."""
    bare = unwrapped(mechanism)
    return bare if isinstance(bare, BallJointed) else None


def balls_of(mechanism: Mechanism) -> tuple[Ball, ...]:
    """Return the ball joints of a mechanism, or an empty tuple."""
    jointed = ball_jointed(mechanism)
    return jointed.balls if jointed else ()
