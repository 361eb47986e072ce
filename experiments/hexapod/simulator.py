"""Simulate a hexapod with errors, without code of gpmodel: leg lengths from given poses.

A chosen platform pose needs no loop closure: the length of a leg is the distance of its two true balls. The encoder
reads this length less its error; the screw of one leg has a cyclic error of one cycle per turn.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.blind.simulator import Array

LEGS = 6
BASE, BASE_PAIR, PLATFORM, PLATFORM_PAIR = 0.350, np.radians(20.0), 0.200, np.radians(30.0)
TOOL = np.array([0.0, 0.0, 0.08])
HOME, TRAVEL, TILT = 0.5047, np.array([0.05, 0.05, 0.03]), np.radians(6.0)
"""Height of the platform over the base with the legs at half stroke, and how far from there it goes, m and rad."""

STROKE = (0.500, 0.600)
"""m, what the encoders may read."""

GEOMETRY, LEAD, SCREW = 1e-4, 5e-3, (6e-6, 1e-5)
"""m: of ball centres and lengths; lead of the screws; its error's amplitude, between these."""

POINT_NOISE, TURN_NOISE = 2e-6, 5e-6
POSES = 120


@dataclass(frozen=True)
class Machine:
    """lower, upper: (6, 3) true ball centres, m. offset: (6,) m. leg: whose screw errs, by amplitude, m, and phase."""

    lower: Array
    upper: Array
    offset: Array
    leg: int
    amplitude: float
    phase: float


def ring(radius: float, angles: tuple[float, float]) -> Array:
    """Three pairs of balls (6, 3) on a circle, m."""
    at = np.add.outer(np.radians([0.0, 120.0, 240.0]), angles).ravel()
    return radius * np.column_stack([np.cos(at), np.sin(at), np.zeros(LEGS)])


def draw_machine(rng: np.random.Generator, planted: bool) -> Machine:
    """A machine with geometry of its own, and one bad screw where `planted`."""
    half = np.pi / 3 - PLATFORM_PAIR / 2
    return Machine(
        ring(BASE, (-BASE_PAIR / 2, BASE_PAIR / 2)) + GEOMETRY * rng.normal(size=(LEGS, 3)),
        ring(PLATFORM, (-half, half)) + GEOMETRY * rng.normal(size=(LEGS, 3)),
        GEOMETRY * rng.normal(size=LEGS),
        int(rng.integers(LEGS)),
        float(rng.uniform(*SCREW)) * planted,
        float(rng.uniform(0.0, 2.0 * np.pi)),
    )


def readings(machine: Machine, place: Array, turn: Rotation) -> Array:
    """Return the encoder readings (N, 6), m, of platforms at place (N, 3), m, turned by `turn`."""
    upper = np.stack([turn.apply(ball) for ball in machine.upper], axis=1) + place[:, None]
    read = np.linalg.norm(upper - machine.lower, axis=2) - machine.offset
    wave = 2.0 * np.pi * read[:, machine.leg] / LEAD + machine.phase
    read[:, machine.leg] -= machine.amplitude * np.sin(wave)
    return np.asarray(read)


def table(seed: int, planted: bool = True, poses: int = POSES) -> tuple[str, Machine]:
    """The measured table of machine `seed` as the text of a CSV file, and the machine."""
    rng = np.random.default_rng([1962, seed, planted])
    machine = draw_machine(rng, planted)
    tried = rng.uniform(-1.0, 1.0, (4 * poses, 6))
    place, turn = np.array([0.0, 0.0, HOME]) + TRAVEL * tried[:, :3], Rotation.from_rotvec(TILT * tried[:, 3:])
    read = readings(machine, place, turn)
    kept = np.flatnonzero(((read > STROKE[0]) & (read < STROKE[1])).all(axis=1))[:poses]
    place, turn = place[kept], turn[kept]
    instrument, origin = Rotation.from_rotvec(rng.uniform(-1.5, 1.5, 3)), rng.normal(0.0, 2.0, 3)
    point = instrument.apply(turn.apply(TOOL) + place) + origin + rng.normal(0.0, POINT_NOISE, (poses, 3))
    seen = Rotation.from_rotvec(rng.normal(0.0, TURN_NOISE, (poses, 3))) * instrument * turn
    rows = np.hstack([1e3 * read[kept], 1e3 * point, seen.as_rotvec()])
    names = [
        *(f"L{i} [mm]" for i in range(1, LEGS + 1)),
        "x [mm]",
        "y [mm]",
        "z [mm]",
        "rx [rad]",
        "ry [rad]",
        "rz [rad]",
    ]
    return "\n".join([",".join(names), *(",".join(f"{v:.12g}" for v in row) for row in rows)]) + "\n", machine
