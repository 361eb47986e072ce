"""Define the forms of the errors of a blind robot.

An effect is a small motion, in metres and radians, at one or more frames, or a shift of what the instrument reads.
`true` is what the robot does, per unit; `basis` is what an oracle told the form would fit (phase known up to a sine and
cosine, the moved amount unknown).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from experiments.blind.simulator import INSTRUMENT, Arm, Array, Loads

Motion = dict[int, Array]
X, Y, Z, RX, RY, RZ = range(6)
Names = list[list[str]]


@dataclass(frozen=True)
class World:
    """All that a pose is known by: joint values (N, n), extra columns by name, row number as a fraction 0..1, loads,
    tool (3,), the nominal point in the instrument's frame (N, 3), joint values before the first row where known."""

    arm: Arm
    q: Array
    extra: Mapping[str, Array]
    row: Array
    loads: Loads
    tool: Array
    point: Array
    start: Array | None = None

    def angle(self, joint: int) -> Array:
        return self.q[:, joint - 1]

    def torque(self, joint: int) -> Array:
        return self.loads.torque[:, joint - 1]

    def before(self, joint: int) -> float:
        """Value of a joint before the first row; that of the first row where nobody knows."""
        return float((self.q[0] if self.start is None else self.start)[joint - 1])


@dataclass(frozen=True)
class Shape:
    """One drawn effect: the same constants on the measured and on the fresh poses.

    named: sets of inputs that count as the right answer, shell patterns on the names in a report; called: patterns on
    the name of a finding, in small letters, that do too.  place: "robot" or "instrument".
    """

    true: Callable[[World], Motion]
    basis: Callable[[World], list[Motion]]
    named: Names
    constants: dict[str, float]
    called: list[str] = field(default_factory=list)
    place: str = "robot"


def turn(joint: int, phi: Array, axis: int = RZ) -> Motion:
    """A motion along or about one axis of the frame carried by a joint; RZ is a revolute joint's own axis."""
    twist = np.zeros((len(phi), 6))
    twist[:, axis] = phi
    return {joint: twist}


def drive(arm: Arm, joint: int) -> int:
    """The axis a joint moves along or about."""
    return Z if joint in arm.prismatic else RZ


def shift(vectors: Array) -> Motion:
    """(N, 3) shifts of what the instrument reads."""
    return {INSTRUMENT: np.hstack([vectors, np.zeros_like(vectors)])}


def combine(weights: Array, motions: list[Motion]) -> Motion:
    out: Motion = {}
    for weight, motion in zip(weights, motions, strict=True):
        for slot, twist in motion.items():
            out[slot] = out.get(slot, 0.0) + weight * twist
    return out


def fixed(motion: Callable[[World], Motion], named: Names, **constants: float) -> Shape:
    """A form with one unknown amount."""
    return Shape(motion, lambda w: [motion(w)], named, constants)


def mixed(basis: Callable[[World], list[Motion]], weights: Array, named: Names, **constants: float) -> Shape:
    """A form with several columns, whose true weights are drawn."""
    return Shape(lambda w: combine(weights, basis(w)), basis, named, constants)


def load_names(joint: int) -> Names:
    """A torque about a joint, or the angles it is made of (different inputs must match different patterns)."""
    angles = ["J2", "J3"] if joint <= 3 else [f"J{joint}", "J[2-6]"]
    return [[f"torque_J{joint}"], [f"moment_J{joint}_z"], angles]
