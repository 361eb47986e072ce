"""Simulate a test rig: poses set by hand, approximate angles, ball positions measured by a CMM."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gpmodel.arrays import Array
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset
from joints.passive_joint import JOINTS, PARAMETERS, PassiveJoint, tooling_ball_position

Disturbance = Callable[[Array, Mapping[str, Array]], Mapping[int, Array]]
"""True angles (N, 3) and extra columns give, by thesis index, what is added to a parameter at each pose (N,)."""


@dataclass(frozen=True)
class Rig:
    """Truth of one rig. parameters: thesis index -> constant value, m or rad.

    translation, rotation_deg: of the joint in the CMM's system, m and roll-pitch-yaw degrees (Table 3.4).
    noise: m, one coordinate. angle_noise: rad, of the angles in the table. reach: (3,) rad, poses within ± that.
    """

    joint: PassiveJoint
    translation: tuple[float, float, float] = (0.12388, 0.02811, -0.20564)
    rotation_deg: tuple[float, float, float] = (4.06, -0.77, -1.83)
    parameters: Mapping[int, float] = field(default_factory=dict)
    noise: float = 2e-6
    angle_noise: float = float(np.radians(0.5))
    reach: tuple[float, float, float] = (1.05, 0.8, 1.05)

    def poses(self, count: int, rng: np.random.Generator) -> Array:
        """True angles (N, 3), uniform within reach."""
        return rng.uniform(-1.0, 1.0, (count, 3)) * np.asarray(self.reach)

    def measure(
        self,
        q: Array,
        rng: np.random.Generator,
        extras: Mapping[str, tuple[str, Array]] | None = None,
        disturbance: Disturbance = lambda q, extras: {},
    ) -> Dataset:
        """The table of a session at true angles q (N, 3): approximate angles and measured positions.

        extras: column -> (unit, values). Positions come from the exact extended kinematics.
        """
        columns = extras or {}
        values = {name: column for name, (_, column) in columns.items()}
        parameters = np.zeros((len(q), PARAMETERS))
        for index, value in self.parameters.items():
            parameters[:, index - 1] += value
        for index, added in disturbance(q, values).items():
            parameters[:, index - 1] += added
        base = np.concatenate([self.translation, np.radians(self.rotation_deg)])
        parameters[:, :6] += base
        position = tooling_ball_position(q, parameters, np.asarray(self.joint.tooling_ball))
        return Dataset(
            joints=JOINTS,
            q=q + self.angle_noise * rng.standard_normal(q.shape),
            position=position + self.noise * rng.standard_normal(position.shape),
            rotation=np.full_like(position, np.nan),
            row=np.arange(1, len(q) + 1),
            payload=np.zeros(len(q)),
            extras=values,
            extra_units={name: unit for name, (unit, _) in columns.items()},
            source="simulated rig",
        )

    @property
    def registration(self) -> Array:
        """The joint's frame in the CMM's system, (4, 4), before any error parameter."""
        frame = np.eye(4)
        for axis, angle in enumerate(np.radians(self.rotation_deg)):
            twist = np.zeros(6)
            twist[3 + axis] = angle
            frame = frame @ se3.exp(twist)
        frame[:3, 3] = self.translation
        return frame
