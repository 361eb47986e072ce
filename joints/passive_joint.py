"""A passive joint as a Mechanism: rotations about axes through one centre, and a tooling ball at a distance."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, GRAVITY, Ball, Joint, Shift
from gpmodel.model.effect import Effect, effect_at
from gpmodel.numerics import se3
from joints.settings import Settings, laid_over, load_settings, positive, read_toml
from robots.chain import SerialChain
from robots.links import Link


@dataclass(frozen=True)
class Rotation:
    """One rotation of a joint about its axis x, y or z. lower, upper: limits of the angle, rad. measured: True if the
    rotation has a sensor."""

    name: str
    axis: str
    lower: float
    upper: float
    measured: bool = False

    @property
    def index(self) -> int:
        """Index of the axis: 0 for x, 1 for y, 2 for z."""
        return "xyz".index(self.axis)


@dataclass(frozen=True)
class PassiveJoint:
    """A spherical or universal joint: two or three rotations about axes that meet in one centre; a Mechanism.

    tooling_ball: nominal centre (x, y, z) of the measured tooling ball, m, in the frame after the last rotation.
    gravity: acceleration of gravity (3,), m/s², in the socket's frame.
    payload_com: centre of mass (3,) of a payload in the tooling ball's frame, m.
    reached: position (3,) of the tooling ball in its nominal frame after a first fit, m; thermal growth of the lever
    from the centre to the tooling ball includes this position.
    Raises InputError for a tooling ball in the joint's centre, or rotations that are not two or three with different
    names and changing axes.
    """

    tooling_ball: tuple[float, float, float]
    rotations: tuple[Rotation, ...]
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY)
    payload_com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    name: str = "spherical-joint"
    reached: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not np.linalg.norm(self.tooling_ball) > 1e-6:
            raise InputError(
                f"{self.name}: the tooling ball is at the centre of the joint; expected a tooling ball on a shaft"
            )
        if len(self.rotations) not in (2, 3):
            raise InputError(f"{self.name}: {len(self.rotations)} rotations, expected 2 (universal) or 3 (spherical)")
        if len({r.name for r in self.rotations}) < len(self.rotations):
            raise InputError(
                f"{self.name}: rotations {', '.join(r.name for r in self.rotations)}, expected different names"
            )
        if any(a.axis == b.axis for a, b in pairwise(self.rotations)):
            axes = ", ".join(r.axis for r in self.rotations)
            raise InputError(f"{self.name}: rotations about {axes}, expected different axes for successive rotations")

    def with_angles(self, *, measured: bool) -> "PassiveJoint":
        """Return the joint with sensors for all angles, or for no angle."""
        return replace(self, rotations=tuple(replace(r, measured=measured) for r in self.rotations))

    def reaching(self, point: Iterable[float]) -> "PassiveJoint":
        """Return the joint with its tooling ball at `point` (3,), m, in the nominal frame of the tooling ball."""
        return replace(self, reached=vector(tuple(point)))

    @cached_property
    def levers(self) -> dict[str, Array]:
        """{slot: vector (3,), m, from centre to tooling ball, which grows with temperature, in the slot's frame}."""
        return {"tool": np.add(self.tooling_ball, self.reached)}

    @property
    def balls(self) -> tuple[Ball, ...]:
        """The ball of the joint if a rotation has no sensor, otherwise nothing. Errors can shift the centre of the ball
        along an axis of the base, or along the line to the tooling ball."""
        angles = tuple(r.name for r in self.rotations if not r.measured)
        lever = self.levers["tool"] / np.linalg.norm(self.levers["tool"])
        shifts: dict[str, Shift] = {f"along {a}": (("base", f"T{a}", 1.0),) for a in "zxy"}
        shifts["along the lever"] = tuple(("tool", f"T{a}", float(w)) for a, w in zip("xyz", lever, strict=True) if w)
        return (Ball("", angles, shifts),) if angles else ()

    def turned(self, q: Array) -> dict[str, Array]:
        """Return an empty dictionary, because the angles of the ball are joint coordinates."""
        return {}

    @cached_property
    def arm(self) -> SerialChain:
        """The rotations as a serial chain of links without mass; its tool is the tooling ball."""
        names, limits = zip(*((r.name, (r.lower, r.upper)) for r in self.rotations), strict=True)
        links = tuple(Link(r.name, np.eye(4), f"R{r.axis}") for r in self.rotations)
        return SerialChain(
            self.name, links, se3.shift(self.tooling_ball), names, np.eye(len(links)), np.array(limits),
            gravity=np.asarray(self.gravity), payload_com=np.asarray(self.payload_com),
        )  # fmt: skip

    @property
    def slots(self) -> tuple[str, ...]:
        return self.arm.slots

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        return tuple(replace(j, measured=r.measured) for j, r in zip(self.arm.joints, self.rotations, strict=True))

    def transforms(self, q: Array) -> Array:
        return self.arm.transforms(q)

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Return the gravity loads of a payload on the shaft, named as in the Mechanism protocol; without a payload, an
        empty dictionary."""
        return self.arm.loads(q, payload)


def turn(points: Array, axis: int, angle: Array) -> Array:
    """Rotate points (..., 3) about coordinate axis 0, 1 or 2 by angles (...), rad."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    out = points.copy()
    out[..., i] = c * points[..., i] - s * points[..., j]
    out[..., j] = s * points[..., i] + c * points[..., j]
    return out


def vector(values: Sequence[float]) -> tuple[float, float, float]:
    """Return three numbers as a tuple. Raises InputError unless there are three numbers."""
    if len(values) != 3:
        raise InputError(f"{tuple(values)}: expected three lengths, x, y and z")
    x, y, z = (float(v) for v in values)
    return x, y, z


FRAMES = ("Tm_Ts", "Ts_Tbr", "Tbr_Tbp", "Tbp_Tby", "Tby_TCP")
JOINTS = ("J1", "J2", "J3")
PARAMETERS = len(FRAMES) * len(AXES)


@dataclass(frozen=True)
class Parameter:
    """One of the thirty error parameters: number in the thesis, frame and axis, and the slot at which it acts."""

    index: int
    frame: str
    axis: str
    slot: str

    @property
    def name(self) -> str:
        """Number, axis and frame of the error parameter."""
        return f"{self.index} {self.axis} {self.frame}"

    @property
    def effect(self) -> Effect:
        """The error parameter to first order, as an effect with a constant twist."""
        return effect_at(self.name, self.slot, self.axis, family="geometric")


def _slot(frame: int, axis: int) -> str:
    """Return the frame (before or after a rotation) at which a constant twist is equivalent to an error parameter."""
    if frame == 0:
        return "base"
    if frame == 4:
        return "tool"
    return f"{JOINTS[frame - 1]}.{'moving' if axis - 3 >= frame - 1 else 'fixed'}"


THESIS_PARAMETERS = tuple(
    Parameter(6 * i + k + 1, frame, axis, _slot(i, k)) for i, frame in enumerate(FRAMES) for k, axis in enumerate(AXES)
)


def parameter(index: int) -> Parameter:
    """Return the error parameter with number `index` in the thesis, 1 to 30."""
    return THESIS_PARAMETERS[index - 1]


def tooling_ball_position(q: Array, parameters: Array, tooling_ball: Array) -> Array:
    """Return positions (..., 3) of the tooling ball, m, in the measurement system by the extended forward kinematics.

    q: joint angles (..., 3), rad. parameters: the thirty errors (..., 30) in the order of Table 3.2, m and rad.
    tooling_ball: centre (3,) of the ball in the frame after the yaw rotation, m. Leading array axes broadcast.

        T = Tm_Ts · Ts_Tbr(q1) · Tbr_Tbp(q2) · Tbp_Tby(q3) · Tby_TCP
        T_k = Trans(Tx, Ty, Tz) · Rx(Rx + q1) · Ry(Ry + q2) · Rz(Rz + q3)

    Each joint angle enters one frame only. Source: Robertson (2003), Figures 3.13 to 3.15 and Table 3.2.
    """
    shape = np.broadcast_shapes(q.shape[:-1], parameters.shape[:-1])
    point = np.broadcast_to(tooling_ball, (*shape, 3)) + parameters[..., 24:27]
    for frame in (3, 2, 1, 0):
        block = parameters[..., 6 * frame : 6 * frame + 6]
        for axis in (2, 1, 0):
            own = q[..., frame - 1] if frame and axis == frame - 1 else 0.0
            point = turn(point, axis, np.broadcast_to(block[..., 3 + axis] + own, shape))
        point = point + block[..., :3]
    return point


KINDS = ("spherical", "universal")
"""Kinds of joints that are a mechanism alone. The machines `hexapod` and `tau` have twelve ball joints."""

SECTIONS = ("preload", "contact", "thermal", "film", "stiffness", "dynamics", "budget", "demand")
"""Sections of a TOML file for `gpmodel joint design`."""


def kind_of(path: Path) -> Any:
    """Return the kind of mechanism that a TOML file describes; None for a table of Denavit-Hartenberg rows."""
    return read_toml(path).get("kind")


def spherical_joint() -> PassiveJoint:
    """Return the joint of the thesis on its test rig."""
    return _built(load_settings("spherical_joint"), "spherical_joint.toml")


def read_joint(path: Path) -> PassiveJoint:
    """Read a joint from a TOML file.

        kind = "spherical"             # or "universal"; defaults are in joints/data/<kind>_joint.toml
        name = "leg 3, upper joint"

        [tooling_ball]
        centre = ["0 mm", "0 mm", "60 mm"]

    `gpmodel joint mechanism --defaults` prints a complete file. A file may also contain sections of the design studies
    (`[preload]`, `[film]`, ...), which `gpmodel joint design` reads.
    Raises InputError for an unknown kind or key, a missing unit, a tooling ball in the joint's centre or inside the
    ball, a ball smaller than its socket's opening, or other than two or three rotations about different axes.
    """
    given = read_toml(path)
    kind = given.get("kind")
    if kind not in KINDS:
        raise InputError(f"{path.name}: kind = {kind!r}, expected 'spherical', 'universal', 'hexapod' or 'tau'")
    own = {key: value for key, value in given.items() if key not in SECTIONS}
    joint = _built(laid_over(f"{kind}_joint", own, path.name), path.name)
    return joint if "name" in given else replace(joint, name=path.stem)


def _built(s: Settings, file: str) -> PassiveJoint:
    centre, radius = vector(s["tooling_ball"]["centre"]), s["tooling_ball"]["diameter"] / 2
    positive(f"{file}: tooling_ball.diameter", 2 * radius, "m")
    lever = float(np.linalg.norm(centre))
    if not lever > 1e-6:
        raise InputError(
            f"{file}: tooling_ball.centre is {lever:g} m from the centre of the joint; expected a larger distance"
        )
    if "ball" in s:
        _check_ball(s, lever, file)
    rotations = tuple(_rotation(entry, f"{file}: rotation[{i}]") for i, entry in enumerate(s["rotation"]))
    return PassiveJoint(centre, rotations, vector(s["gravity"]), name=s["name"])


def _check_ball(s: Settings, lever: float, file: str) -> None:
    ball, opening = s["ball"]["diameter"], s["socket"]["opening"]
    positive(f"{file}: ball.diameter", ball, "m")
    positive(f"{file}: socket.opening", opening, "m")
    if opening >= ball:
        raise InputError(
            f"{file}: ball.diameter = {1e3 * ball:g} mm falls through socket.opening = {1e3 * opening:g} mm; "
            "expected a larger ball"
        )
    reach = (ball + s["tooling_ball"]["diameter"]) / 2
    if lever < reach:
        raise InputError(
            f"{file}: tooling_ball.centre is {1e3 * lever:g} mm from the centre of the joint, inside the ball; "
            f"expected at least {1e3 * reach:g} mm"
        )


def _rotation(entry: dict[str, Any], where: str) -> Rotation:
    if entry["axis"] not in ("x", "y", "z"):
        raise InputError(f"{where}.axis = '{entry['axis']}', expected x, y or z")
    if not entry["lower"] < entry["upper"]:
        lower, upper = np.degrees([entry["lower"], entry["upper"]])
        raise InputError(f"{where}: lower = {lower:g} deg, expected below upper = {upper:g} deg")
    return Rotation(entry["name"], entry["axis"], entry["lower"], entry["upper"], entry["measured"])
