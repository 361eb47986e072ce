"""Six measured legs between two rings of ball joints: a Gough platform as a Mechanism with closed loops.

Only the centres of the balls and the lengths matter: 6 x 7 constants, of which 12 are equivalent to poses of base and
platform. Source: Gough and Whitehall 1962.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Joint
from gpmodel.numerics.se3 import shift
from joints.legs import LEGS, OnLegs, described, held
from joints.passive_joint import vector
from joints.settings import Settings, positive


@dataclass(frozen=True, eq=False, kw_only=True)
class Hexapod(OnLegs):
    """A platform on six legs with a ball joint at either end. A Mechanism with loops closed by Newton's method.
    limits: shortest and longest leg, m."""

    axial: ClassVar[str] = "torque_L{i}"
    limits: tuple[float, float]

    @cached_property
    def slots(self) -> tuple[str, ...]:
        """The base; of every leg its lower ball, the leg and its upper ball; the measured frame on the platform."""
        return ("base", *self.link_slots, "tool")

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """L1 to L6: the measured lengths of the legs between the centres of their balls."""
        return tuple(
            Joint(f"L{i}", "prismatic", *self.limits, ((f"L{i}.moving", "Tz", 1.0),)) for i in range(1, LEGS + 1)
        )

    @property
    def constants(self) -> tuple[tuple[str, str], ...]:
        """The length of each leg, then the centres of its balls, in the axes of base and platform."""
        return self.link_constants

    @property
    def levers(self) -> dict[str, Array]:
        """Levers as in OnLegs.link_levers, with the legs at half stroke."""
        return self.link_levers(self.home[0])

    @property
    def home(self) -> Array:
        """Lengths (1, 6) of all legs at half stroke, m."""
        return np.full((1, LEGS), np.mean(self.limits))

    def feet(self, frames: Array, own: Array, q: Array) -> tuple[Array, Array]:
        """Place the lower balls on the base; see OnLegs.feet."""
        frames[1:-1:3] = own[0] @ shift(self.base)[:, None] @ own[1:-1:3]
        apart = np.linalg.norm((self.platform - self.base)[:, :2], axis=1).mean()
        high = np.sqrt(max(np.mean(self.limits) ** 2 - apart**2, 0.0)) + np.mean(self.base - self.platform, 0)[2]
        return q.T, np.broadcast_to(shift([0.0, 0.0, high]), (len(q), 4, 4))

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """Return the loads of the weight: torque_L1 .. (N) on each length, force_base_x ..
        moment_base_z on the base."""
        carried = np.asarray(payload, dtype=float)
        if not np.any(carried) and not self.mass:
            return {}
        legs, base = self.weight(self.assembled(q, {}), carried)
        return {f"torque_{joint.name}": legs[:, i] for i, joint in enumerate(self.joints)} | base


def hexapod(path: Path | None = None) -> Hexapod:
    """Return the hexapod of a TOML file, the built-in one by default.

    Raises InputError for an unknown key, a missing unit, a ring or range without size, or legs that cannot meet or do
    not hold the platform.
    """
    return described("hexapod", path, _built)


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
    return held(machine, file)


def _ring(radius: float, angles: list[float]) -> Array:
    """Return the centres (6, 3), m, of three pairs of balls on a circle. angles: angles of one pair, rad."""
    at = np.concatenate([np.asarray(angles) + turn for turn in np.radians([0.0, 120.0, 240.0])])
    return radius * np.column_stack([np.cos(at), np.sin(at), np.zeros(len(at))])
