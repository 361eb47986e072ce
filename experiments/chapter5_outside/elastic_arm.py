"""Simulate elastic robots of the size of an IRB 6400R, without code of gpmodel.

The flange is at  E(u) * prod_i O_i R_i(angle_i)  with E the tilt of the base and O_i the placement of joint i, a little
off from its nominal one. The springs are at the base (about x and y), in joint 4 and in joint 5. Their deflections u
solve K u = torque(u), with the torque of gravity taken where the arm *is*, not where it would be without bending.
Nothing is linearised. Metres, radians, kilograms, newtons.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.blind.simulator import GRAVITY, Array, small_motion

POSES, TRAINING = 90, 40
NOISE = 5e-5
GEOMETRY = 3e-4
STIFFNESS = {"base": 2e6, "J5": 2.5e5, "J4": 3.5e5}
SPREAD = 0.15
ECCENTRICITY = float(np.radians(40 / 3600))
PAYLOAD, PAYLOAD_CENTRE = 150.0, np.array([0.35, 0.0, 0.10])
TOOL_POINT = np.array([0.10, 0.12, 0.10])
LOWEST_TIP = 0.3

AXES = (2, 1, 1, 0, 1, 0)
PLACES = np.array(
    [[0, 0, 0], [0.24, 0, 0.8], [0, 0, 1.05], [0, 0, 0.225], [1.175, 0, 0], [0, 0, 0], [0.2, 0, 0]], dtype=float
)
MASSES = np.array([262.6, 156.2, 149.3, 10.2, 17.7, 41.5])
LIMITS = np.radians([[-180, 180], [-70, 85], [-28, 110], [-300, 300], [-120, 120], [-300, 300]])


@dataclass(frozen=True)
class Robot:
    """errors: (7, 6) of the placements, m and rad. amplitude, phase: (6,) of the encoders' eccentricities, rad.

    compliance: rad/Nm of base, J4 and J5; zero is rigid. instrument: (4, 4) placement of the robot in the tracker.
    """

    errors: Array
    amplitude: Array
    phase: Array
    compliance: dict[str, float]
    instrument: Array


def draw_robot(rng: np.random.Generator, planted: bool) -> Robot:
    """A robot with geometry of its own; bending and eccentric where `planted`, rigid and round where not."""
    softness = {k: float(np.exp(SPREAD * rng.normal())) / v * planted for k, v in STIFFNESS.items()}
    place = np.concatenate([rng.normal(0.0, 3.0, 3), rng.uniform(-1.5, 1.5, 3)])
    return Robot(
        GEOMETRY * rng.normal(size=(7, 6)),
        np.full(6, ECCENTRICITY * planted),
        rng.uniform(0.0, 2 * np.pi, 6),
        softness,
        small_motion(place[None])[0],
    )


def _turn(axis: int, angle: Array) -> Array:
    twist = np.zeros((len(angle), 6))
    twist[:, 3 + axis] = angle
    return small_motion(twist)


def placed(robot: Robot, q: Array, bent: Array) -> tuple[Array, Array]:
    """Frames (8, N, 4, 4) of base, links and flange, and axes (6, N, 3), of a robot bent by (N, 4): tilt x, y, J4, J5.

    q: (N, 6) as the controller has it: joint 3 is held to the ground by the parallel bar.
    """
    angles = q + robot.amplitude * np.sin(q + robot.phase)
    angles[:, 2] -= angles[:, 1]
    angles[:, 3] += bent[:, 2]
    angles[:, 4] += bent[:, 3]
    tilt = np.zeros((len(q), 6))
    tilt[:, 3:5] = bent[:, :2]
    frames, axes = [small_motion(tilt)], []
    offsets = small_motion(robot.errors)
    offsets[:, :3, 3] += PLACES
    for i, axis in enumerate(AXES):
        fixed = frames[-1] @ offsets[i]
        axes.append(fixed[:, :3, axis])
        frames.append(fixed @ _turn(axis, angles[:, i]))
    return np.array([*frames, frames[-1] @ offsets[6]]), np.array(axes)


def gravity_torques(frames: Array, axes: Array) -> Array:
    """(N, 4) moments of all weights about the base's x and y and about the axes of joints 4 and 5, where the arm is."""
    centres = [frames[i + 1][:, :3, :3] @ (PLACES[i + 1] / 2) + frames[i + 1][:, :3, 3] for i in range(6)]
    centres.append(frames[-1][:, :3, :3] @ PAYLOAD_CENTRE + frames[-1][:, :3, 3])
    weights = np.append(MASSES, PAYLOAD)[:, None] * GRAVITY

    def moment(first: int, about: Array) -> Array:
        return np.sum([np.cross(centres[k] - about, weights[k]) for k in range(first, 7)], axis=0)

    base = np.einsum("nji,nj->ni", frames[0][:, :3, :3], moment(0, frames[0][:, :3, 3]))
    about = [np.sum(axes[j] * moment(j, frames[j + 1][:, :3, 3]), axis=1) for j in (3, 4)]
    return np.column_stack([base[:, :2], *about])


def equilibrium(robot: Robot, q: Array) -> Array:
    """Deflections (N, 4), rad, at which every spring carries its gravity torque; each round gains three digits."""
    soft = np.array([robot.compliance[k] for k in ("base", "base", "J4", "J5")])
    bent = np.zeros((len(q), 4))
    for _ in range(50):
        before, bent = bent, soft * gravity_torques(*placed(robot, q, bent))
        if np.abs(bent - before).max() < 1e-14:
            return bent
    raise RuntimeError("the arm finds no rest: its springs are too soft")


def measure(robot: Robot, q: Array, rng: np.random.Generator) -> Array:
    """Points (N, 3) of the tool in the tracker's frame, m, with the tracker's noise."""
    flange = placed(robot, q, equilibrium(robot, q))[0][-1]
    points = flange[:, :3, :3] @ TOOL_POINT + flange[:, :3, 3]
    seen = points @ robot.instrument[:3, :3].T + robot.instrument[:3, 3]
    return seen + rng.normal(0.0, NOISE, seen.shape)


def draw_poses(rng: np.random.Generator, count: int = POSES) -> Array:
    """(count, 6) joint values the controller can reach, uniform, with the flange above the fence around the base."""
    rigid = draw_robot(np.random.default_rng(0), planted=False)
    kept: list[NDArray[np.float64]] = []
    while len(kept) < count:
        q = rng.uniform(LIMITS[:, 0], LIMITS[:, 1])
        if placed(rigid, q[None], np.zeros((1, 4)))[0][-1, 0, 2, 3] > LOWEST_TIP:
            kept.append(q)
    return np.array(kept)


def table(seed: int, planted: bool = True) -> str:
    """The measured table of robot number `seed`, as the text of a CSV file."""
    rng = np.random.default_rng([2003, seed, planted])
    robot, q = draw_robot(rng, planted), draw_poses(rng)
    rows = np.hstack([np.degrees(q), 1e3 * measure(robot, q, rng)])
    head = ",".join([*(f"J{i} [deg]" for i in range(1, 7)), "x [mm]", "y [mm]", "z [mm]"])
    return "\n".join([head, *(",".join(f"{v:.9g}" for v in row) for row in rows)]) + "\n"
