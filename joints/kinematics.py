"""The spherical joint as a chain of five frames: thirty error parameters, and the Mechanism the engine reads.

    T = Tm_Ts · Ts_Tbr(q1) · Tbr_Tbp(q2) · Tbp_Tby(q3) · Tby_TCP
    T_k = Trans(Tx, Ty, Tz) · Rx(Rx + q1) · Ry(Ry + q2) · Rz(Rz + q3)

each joint angle in its own frame only. Source: Robertson (2003), Figures 3.13 to 3.15 and Table 3.2.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, Joint
from gpmodel.model.effect import Effect, effect_at
from gpmodel.numerics import se3

FRAMES = ("Tm_Ts", "Ts_Tbr", "Tbr_Tbp", "Tbp_Tby", "Tby_TCP")
JOINTS = ("J1", "J2", "J3")
PARAMETERS = len(FRAMES) * len(AXES)


@dataclass(frozen=True)
class Parameter:
    """One of the thirty error parameters: its thesis index (from 1), frame and axis, and the slot it acts at."""

    index: int
    frame: str
    axis: str
    slot: str

    @property
    def name(self) -> str:
        return f"{self.index} {self.axis} {self.frame}"

    @property
    def effect(self) -> Effect:
        """The parameter to first order, as the engine's constant twist."""
        return effect_at(self.name, self.slot, self.axis, family="geometric")


def _slot(frame: int, axis: int) -> str:
    """Where a twist acts like this entry of a frame at rest: before the frame's own rotation, or after it."""
    if frame == 0:
        return "base"
    if frame == 4:
        return "tool"
    return f"{JOINTS[frame - 1]}.{'moving' if axis - 3 >= frame - 1 else 'fixed'}"


THESIS_PARAMETERS = tuple(
    Parameter(6 * i + k + 1, frame, axis, _slot(i, k)) for i, frame in enumerate(FRAMES) for k, axis in enumerate(AXES)
)


def parameter(index: int) -> Parameter:
    """The parameter with a thesis index, 1 to 30."""
    return THESIS_PARAMETERS[index - 1]


def _turn(points: Array, axis: int, angle: Array) -> Array:
    """Points (..., 3) rotated about a coordinate axis by angles (...), rad."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    out = points.copy()
    out[..., i] = c * points[..., i] - s * points[..., j]
    out[..., j] = s * points[..., i] + c * points[..., j]
    return out


def tooling_ball_position(q: Array, parameters: Array, tooling_ball: Array) -> Array:
    """Extended forward kinematics: positions (..., 3), m, in the measurement system.

    q: (..., 3) rad. parameters: (..., 30) m and rad, thesis order; all zero gives the nominal kinematics.
    tooling_ball: (3,) m, its centre in the frame after the yaw rotation. Leading shapes broadcast.
    """
    shape = np.broadcast_shapes(q.shape[:-1], parameters.shape[:-1])
    point = np.broadcast_to(tooling_ball, (*shape, 3)) + parameters[..., 24:27]
    for frame in (3, 2, 1, 0):
        block = parameters[..., 6 * frame : 6 * frame + 6]
        for axis in (2, 1, 0):
            own = q[..., frame - 1] if frame and axis == frame - 1 else 0.0
            point = _turn(point, axis, np.broadcast_to(block[..., 3 + axis] + own, shape))
        point = point + block[..., :3]
    return point


def _rotation_about(axis: int, angle: Array) -> Array:
    out = np.zeros((len(angle), 4, 4))
    out[:, 3, 3] = 1.0
    for k, unit in enumerate(np.eye(3)):
        out[:, :3, k] = _turn(np.broadcast_to(unit, (len(angle), 3)), axis, angle)
    return out


@dataclass(frozen=True)
class SphericalJoint:
    """A passive ball and socket: roll, pitch and yaw about one centre, usually none of them measured. A Mechanism.

    tooling_ball: (x, y, z) m, the measured centre in the frame after the yaw rotation. limits: of the joints, rad.
    gravity: (3,) m/s² in the socket's frame. payload_com: (3,) m, centre of a payload in the tooling ball's frame.
    angles_known: whether the table's angles are measured rather than approximate.
    Raises InputError for a tooling ball in the joint's centre.
    """

    tooling_ball: tuple[float, float, float]
    limits: tuple[tuple[float, float], ...]
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.80665)
    payload_com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angles_known: bool = False
    name: str = "spherical-joint"

    def __post_init__(self) -> None:
        if not np.linalg.norm(self.tooling_ball) > 1e-6:
            raise InputError(f"{self.name}: the tooling ball is at radius 0 from the joint's centre; expected a shaft")

    @cached_property
    def slots(self) -> tuple[str, ...]:
        return ("base", *(f"{j}.{side}" for j in JOINTS for side in ("fixed", "moving")), "tool")

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        return tuple(
            Joint(name, "revolute", lower, upper, ((f"{name}.moving", axis, 1.0),), measured=self.angles_known)
            for name, axis, (lower, upper) in zip(JOINTS, AXES[3:], self.limits, strict=True)
        )

    def transforms(self, q: Array) -> Array:
        """Nominal transforms (8, N, 4, 4) between successive slots: the rotations and the shaft, in metres."""
        q = np.asarray(q, dtype=float)
        if q.ndim != 2 or q.shape[1] != len(JOINTS):
            raise InputError(f"{self.name}: joint values of shape {q.shape}, expected (poses, 3) for J1, J2, J3")
        out = np.broadcast_to(np.eye(4), (len(self.slots), len(q), 4, 4)).copy()
        for i in range(3):
            out[2 + 2 * i] = _rotation_about(i, q[:, i])
        out[-1, :, :3, 3] = self.tooling_ball
        return out

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Gravity loads of a payload on the shaft, by the names of the Mechanism protocol; empty without one."""
        if not np.any(payload):
            return {}
        frames = se3.chain(self.transforms(q))
        force = np.asarray(payload)[:, None] * np.asarray(self.gravity)
        centre = frames[-1, :, :3, 3] + frames[-1, :, :3, :3] @ np.asarray(self.payload_com)
        out: dict[str, Array] = {}
        for name, slot in (("base", "base"), *((j, f"{j}.moving") for j in JOINTS)):
            turn = frames[self.slots.index(slot), :, :3, :3]
            local = np.einsum("nji,knj->kni", turn, np.stack([force, np.cross(centre, force)]))
            for kind, values in zip(("force", "moment"), local, strict=True):
                out |= {f"{kind}_{name}_{axis}": values[:, k] for k, axis in enumerate("xyz")}
        for k, name in enumerate(JOINTS):
            out[f"torque_{name}"] = out[f"moment_{name}_{'xyz'[k]}"]
        return out


def vector(values: Sequence[float]) -> tuple[float, float, float]:
    """Three numbers, as a tuple. Raises InputError for any other count."""
    if len(values) != 3:
        raise InputError(f"{tuple(values)}: expected three lengths, x, y and z")
    x, y, z = (float(v) for v in values)
    return x, y, z
