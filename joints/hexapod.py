"""Machines on six links with a ball at every end, as Mechanisms with closed loops: a Gough platform, a Tau robot.

The hexapod has six measured legs between two rings of balls. The parameters are the centres of the balls and the
lengths of the legs: 6 x 7 constants, of which 12 are equivalent to poses of base and platform. Source: Gough and
Whitehall 1962. Three arms of the Tau robot, rotated or pushed, carry three, two and one links. Sources: Robertson 2003,
1.2; Brogårdh 2002, PKM research: important issues, as seen from a product development perspective at ABB Robotics.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, Joint
from gpmodel.numerics import se3
from gpmodel.numerics.se3 import along, shift
from joints.legs import LEGS, SixLegged, from_settings, with_supported_home
from joints.passive_joint import vector
from joints.settings import Settings, positive, require


@dataclass(frozen=True, eq=False, kw_only=True)
class Hexapod(SixLegged):
    """A hexapod: a platform on six legs with a ball joint at either end; Newton's method closes the loops of the legs.
    limits: shortest and longest length of a leg, m."""

    axial: ClassVar[str] = "torque_L{i}"
    limits: tuple[float, float]

    @cached_property
    def slots(self) -> tuple[str, ...]:
        """Names of the frames at which errors act: base, lower ball, body and upper ball of every leg, tool."""
        return ("base", *self.link_slots, "tool")

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """Joints L1 to L6: the measured lengths of the legs between the centres of their balls."""
        return tuple(
            Joint(f"L{i}", "prismatic", *self.limits, ((f"L{i}.moving", "Tz", 1.0),)) for i in range(1, LEGS + 1)
        )

    @property
    def constants(self) -> tuple[tuple[str, str], ...]:
        """Geometric constants (frame, axis): length of each leg, then the coordinates of the centres of its balls."""
        return self.link_constants

    @property
    def levers(self) -> dict[str, Array]:
        """{frame: vector [m] that grows with temperature}: positions of the balls. A leg's measured length is a joint
        value, which grows as a joint's travel does."""
        return self.link_levers(np.zeros(LEGS))

    @property
    def home(self) -> Array:
        """Lengths (1, 6) of the legs at half stroke, m."""
        return np.full((1, LEGS), np.mean(self.limits))

    def feet(self, frames: Array, own: Array, q: Array) -> tuple[Array, Array]:
        frames[1:-1:3] = own[0] @ shift(self.base)[:, None] @ own[1:-1:3]
        apart = np.linalg.norm((self.platform - self.base)[:, :2], axis=1).mean()
        high = np.sqrt(max(np.mean(self.limits) ** 2 - apart**2, 0.0)) + np.mean(self.base - self.platform, 0)[2]
        return q.T, np.broadcast_to(shift([0.0, 0.0, high]), (len(q), 4, 4))

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Return the loads of the weight at each pose: torque_L1 to torque_L6, forces on the legs [N]; force_base_x to
        moment_base_z, force [N] and moment [N m] on the base."""
        carried = np.asarray(payload, dtype=float)
        if not np.any(carried) and not self.mass:
            return {}
        legs, base = self.weight(self.assembled(q, {}), carried)
        return {f"torque_{joint.name}": legs[:, i] for i, joint in enumerate(self.joints)} | base


def hexapod(path: Path | None = None) -> Hexapod:
    """Return the hexapod that a TOML file describes; without a file, the built-in one.

    Raises InputError for an unknown key, a missing unit, a ring or range without size, or legs that cannot meet or do
    not hold the platform.
    """
    return from_settings("hexapod", path, _built)


def _built(s: Settings, file: str) -> Hexapod:
    for place, key, unit in (("base", "radius", "m"), ("platform", "radius", "m"), ("leg", "shortest", "m")):
        positive(f"{file}: {place}.{key}", s[place][key], unit)
    shortest, longest = s["leg"]["shortest"], s["leg"]["longest"]
    if not shortest < longest:
        raise InputError(f"{file}: leg.longest = {1e3 * longest:g} mm, expected above shortest = {1e3 * shortest:g} mm")
    base = _ring(s["base"]["radius"], [sign * s["base"]["pair"] / 2 for sign in (-1, 1)])
    half = np.pi / 3 - s["platform"]["pair"] / 2
    platform = _ring(s["platform"]["radius"], [-half, half])
    machine = Hexapod(
        limits=(shortest, longest), name=s["name"], base=base, platform=platform, tool=vector(s["tool"]["centre"]),
        mass=s["platform"]["mass"], gravity=vector(s["gravity"]),
    )  # fmt: skip
    return with_supported_home(machine, file)


def _ring(radius: float, angles: list[float]) -> Array:
    """Return the centres (6, 3), m, of three pairs of balls on a circle. angles: angles of one pair, rad."""
    at = np.concatenate([np.asarray(angles) + turn for turn in np.radians([0.0, 120.0, 240.0])])
    return radius * np.column_stack([np.cos(at), np.sin(at), np.zeros(len(at))])


ARMS = (0, 0, 0, 1, 1, 2)
"""Number (from 0) of the arm that carries each link of the Tau robot: three links, two links and one link."""


@dataclass(frozen=True)
class Actuator:
    """Actuator of a cluster of links of the Tau robot.

    kind: revolute (about z of `frame`) or prismatic (along z of `frame`).
    frame: pose of the actuator in the base frame, 4 x 4 matrix, m.
    lower, upper: limits of the actuator's coordinate, rad or m, zero at home.
    """

    kind: str
    frame: Array
    lower: float
    upper: float

    def moved(self, q: Array) -> Array:
        """Return transforms (poses, 4, 4) of the actuator's motion at its coordinates (poses,), rad or m."""
        return along(5 if self.kind == "revolute" else 2, q)


@dataclass(frozen=True, eq=False, kw_only=True)
class Tau(SixLegged):
    """A Tau robot: a platform on six links of fixed length, in clusters of 3, 2 and 1 links on three actuators.

    actuators: actuators A1 to A3. Positions in `base` are in the frames of the actuators after the actuators' motion.
    start: origin (3,) of the platform with all actuators at home, m; defines the lengths of the links.
    """

    first: ClassVar[int] = 7
    actuators: tuple[Actuator, Actuator, Actuator]
    start: tuple[float, float, float]

    @cached_property
    def slots(self) -> tuple[str, ...]:
        """Names of the frames at which errors act: base, actuators before and after motion, balls and links, tool."""
        arms = (f"A{a}.{side}" for a in range(1, 4) for side in ("fixed", "moving"))
        return ("base", *arms, *self.link_slots, "tool")

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """Joints of the Tau robot, A1 to A3: the measured actuator coordinates."""
        return tuple(
            Joint(f"A{a}", m.kind, m.lower, m.upper, ((f"A{a}.moving", "Rz" if m.kind == "revolute" else "Tz", 1.0),))
            for a, m in enumerate(self.actuators, 1)
        )

    @property
    def constants(self) -> tuple[tuple[str, str], ...]:
        """Geometric constants (frame, axis): zeros and axes of actuators, lengths of links, centres of their balls."""
        axes = (
            (f"A{a}.{side}", axis)
            for a, m in enumerate(self.actuators, 1)
            for side, axis in (
                ("moving", "Rz" if m.kind == "revolute" else "Tz"),
                *(("fixed", axis) for axis in AXES if axis[1] != "z" and (m.kind == "revolute" or axis[0] == "R")),
            )
        )
        return (*axes, *self.link_constants)

    @property
    def levers(self) -> dict[str, Array]:
        """{frame: vector [m] that grows with temperature}: positions of the actuators and balls, and the links."""
        axes = {f"A{a}.fixed": m.frame[:3, :3].T @ m.frame[:3, 3] for a, m in enumerate(self.actuators, 1)}
        return axes | self.link_levers(self.lengths)

    @property
    def home(self) -> Array:
        """Joint values (1, 3) at home, all zero, rad or m."""
        return np.zeros((1, len(self.actuators)))

    @cached_property
    def lengths(self) -> Array:
        """Nominal lengths (6,) of the links, m."""
        carts = np.stack([m.frame for m in self.actuators])[list(ARMS)]
        lower = np.einsum("kij,kj->ki", carts[:, :3, :3], self.base) + carts[:, :3, 3]
        return np.asarray(np.linalg.norm(self.platform + np.array(self.start) - lower, axis=1))

    def links_behind(self, slot: int) -> list[int]:
        return [k for k, arm in enumerate(ARMS) if arm == (slot - 1) // 2]

    def feet(self, frames: Array, own: Array, q: Array) -> tuple[Array, Array]:
        for a, actuator in enumerate(self.actuators):
            frames[1 + 2 * a] = own[0] @ actuator.frame @ own[1 + 2 * a]
            frames[2 + 2 * a] = frames[1 + 2 * a] @ actuator.moved(q[:, a]) @ own[2 + 2 * a]
        frames[7:-1:3] = frames[2:7:2][list(ARMS)] @ shift(self.base)[:, None] @ own[7:-1:3]
        start = np.broadcast_to(shift(self.start), (len(q), 4, 4))
        return np.broadcast_to(self.lengths[:, None], (len(ARMS), len(q))), start

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Return the loads of the weight at each pose.
        torque_A1 to torque_A3: torque [N m] or force [N] on each actuator.
        force_L1_z to force_L6_z: force along each link, N, positive for tension.
        force_base_x to moment_base_z: force [N] and moment [N m] on the base."""
        carried = np.asarray(payload, dtype=float)
        if not np.any(carried) and not self.mass:
            return {}
        frames = self.assembled(q, {})
        legs, base = self.weight(frames, carried)
        out = {f"force_L{i + 1}_z": legs[:, i] for i in range(len(ARMS))}
        for a, joint in enumerate(self.joints):
            moves = self.jacobian(frames) @ self.carried(frames, 2 + 2 * a)
            out[f"torque_{joint.name}"] = np.sum(legs * moves[:, :, AXES.index(joint.drive[0][1])], axis=1)
        return out | base


DRIVES = {"turned": ("revolute", "turn"), "pushed": ("prismatic", "travel")}
"""Joint type of each kind of drive, and the TOML key of the range of the drive."""

FRAMES = {"x": np.eye(3)[:, [1, 2, 0]], "y": np.eye(3)[:, [2, 0, 1]], "z": np.eye(3)}
"""Rotation matrices whose z axis is the named axis of the base."""


def tau(path: Path | None = None) -> Tau:
    """Return the Tau robot that a TOML file describes; without a file, the built-in one.

    Raises InputError for an unknown key, a missing unit, other than three actuators or six links, a range that does not
    contain zero, or links that do not hold the platform.
    """
    return from_settings("tau", path, _built_tau)


def _built_tau(s: Settings, file: str) -> Tau:
    for key, count in (("actuator", 3), ("link", len(ARMS))):
        if len(s[key]) != count:
            raise InputError(f"{file}: {len(s[key])} tables [[{key}]], expected {count}: links 1 to 3 on the first "
                             "actuator, 4 and 5 on the second, 6 on the third")  # fmt: skip
    first, second, third = (_actuator(entry, f"{file}: actuator[{i}]") for i, entry in enumerate(s["actuator"]))
    base, platform = (np.array([vector(link[end]) for link in s["link"]]) for end in ("base", "platform"))
    machine = Tau(
        actuators=(first, second, third), start=vector(s["start"]), name=s["name"], base=base, platform=platform,
        tool=vector(s["tool"]["centre"]), mass=s["platform"]["mass"], gravity=vector(s["gravity"]),
    )  # fmt: skip
    require(machine.lengths > 0, f"{file}: length of a link [m]", machine.lengths, "above 0")
    return with_supported_home(machine, file)


def _actuator(entry: Settings, where: str) -> Actuator:
    if entry["drive"] not in DRIVES:
        raise InputError(f"{where}.drive = '{entry['drive']}', expected turned or pushed")
    if entry["axis"] not in FRAMES:
        raise InputError(f"{where}.axis = '{entry['axis']}', expected x, y or z")
    kind, key = DRIVES[entry["drive"]]
    lower, upper = entry[key][0], entry[key][-1]
    if len(entry[key]) != 2 or not lower < 0.0 < upper:
        raise InputError(
            f"{where}.{key}: {len(entry[key])} values from {lower:g} to {upper:g}, expected the lowest and the highest "
            "coordinate, with zero between the two"
        )
    frame = se3.frame(FRAMES[entry["axis"]], vector(entry["at"]))
    return Actuator(kind, frame @ along(5, np.array([entry["stands"]]))[0], lower, upper)
