"""The spherical joint as a chain of five frames with thirty error parameters.

    T = Tm_Ts · Ts_Tbr(q1) · Tbr_Tbp(q2) · Tbp_Tby(q3) · Tby_TCP
    T_k = Trans(Tx, Ty, Tz) · Rx(Rx + q1) · Ry(Ry + q2) · Rz(Rz + q3)

each joint angle in its own frame only. Source: Robertson (2003), Figures 3.13 to 3.15 and Table 3.2.
"""

from dataclasses import dataclass

import numpy as np

from gpmodel.arrays import Array
from gpmodel.mechanism.protocol import AXES
from gpmodel.model.effect import Effect, effect_at
from joints.passive_joint import turn

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
        """Number, axis and frame of the parameter."""
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
            point = turn(point, axis, np.broadcast_to(block[..., 3 + axis] + own, shape))
        point = point + block[..., :3]
    return point
