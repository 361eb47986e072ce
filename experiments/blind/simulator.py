"""Simulate a robot by plain 4x4 products, without code of gpmodel.

Modified Denavit-Hartenberg rows (alpha, a, d, theta0) give the fixed placement of every joint,

    O_i = Rx(alpha) Tx(a) Tz(d) Rz(theta0),   p = G * prod_i [ E_(i-1) O_i Rz(q_i) ] * E_n * tool

with G the placement of the robot's base in the tracker, E_0 a small motion of the base and E_i a small motion of
the frame carried by joint i; a prismatic joint has Tz(q_i) for Rz(q_i).  What the instrument does wrong is a shift of p
in its own frame.  Gravity loads are sums of masses times lever arms.  Metres, radians, kilograms.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, -9.80665])
INSTRUMENT = -1
FLOOR = 0.05


def rotation_x(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def rotation_z(angle: Array | float) -> Array:
    """(..., 4, 4) rotations about z for angles of shape (...)."""
    angle = np.asarray(angle, dtype=float)
    out = np.zeros((*angle.shape, 4, 4))
    out[..., 0, 0] = out[..., 1, 1] = np.cos(angle)
    out[..., 1, 0] = np.sin(angle)
    out[..., 0, 1] = -out[..., 1, 0]
    out[..., 2, 2] = out[..., 3, 3] = 1.0
    return out


def slide_z(distance: Array) -> Array:
    """(N, 4, 4) translations along z by (N,)."""
    out = np.tile(np.eye(4), (len(distance), 1, 1))
    out[:, 2, 3] = distance
    return out


def translation(x: float, y: float, z: float) -> Array:
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


def small_motion(twist: Array) -> Array:
    """(N, 4, 4) motions: translate by twist[:, :3], then rotate by the rotation vector twist[:, 3:] (Rodrigues)."""
    vector = twist[:, 3:]
    angle = np.linalg.norm(vector, axis=1)[:, None, None]
    x, y, z = vector.T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    half = np.sinc(angle / (2 * np.pi))
    out = np.zeros((len(twist), 4, 4))
    out[:, :3, :3] = np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * (cross @ cross)
    out[:, :3, 3] = twist[:, :3]
    out[:, 3, 3] = 1.0
    return out


@dataclass(frozen=True)
class Arm:
    """rows: (n, 4) alpha, a, d, theta0 [rad, m]; limits: (n, 2) rad or m; masses: (n,) kg; centres: (n, 3) m, link
    frame; prismatic: numbers of the joints that slide, counted from 1."""

    name: str
    rows: Array
    limits: Array
    masses: Array
    centres: Array
    prismatic: frozenset[int] = field(default_factory=frozenset)

    @property
    def joints(self) -> list[str]:
        return [f"J{i + 1}" for i in range(len(self.rows))]

    @property
    def middle(self) -> Array:
        """(n,) joint values half way between the limits."""
        return np.asarray(self.limits.mean(axis=1))

    def drive(self, joint: int, values: Array) -> Array:
        """(N, 4, 4) motions of a joint."""
        return slide_z(values) if joint in self.prismatic else rotation_z(values)

    def origins(self) -> Array:
        """(n, 4, 4) placement of joint i at zero in the frame carried by joint i - 1."""
        return np.array([rotation_x(al) @ translation(a, 0, d) @ rotation_z(t) for al, a, d, t in self.rows])

    def heavier(self, factors: Array) -> Arm:
        """Return the arm with masses multiplied by factors."""
        return replace(self, masses=self.masses * factors)


def frames(arm: Arm, q: Array, twists: dict[int, Array] | None = None) -> Array:
    """(n + 1, N, 4, 4) base and link frames in the nominal base; twists[slot] is (N, 6), slot 0 the base."""
    twists = twists or {}
    current = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    out = []
    for slot, origin in enumerate([None, *arm.origins()]):
        if origin is not None:
            current = current @ origin @ arm.drive(slot, q[:, slot - 1])
        if slot in twists:
            current = current @ small_motion(twists[slot])
        out.append(current)
    return np.array(out)


def points(arm: Arm, q: Array, placement: Array, tool: Array, twists: dict[int, Array]) -> Array:
    """(N, 3) measured points in the tracker; twists[INSTRUMENT][:, :3] shifts what it reads."""
    last = frames(arm, q, twists)[-1]
    in_base = last[:, :3, :3] @ tool + last[:, :3, 3]
    read = in_base @ placement[:3, :3].T + placement[:3, 3]
    return read + twists[INSTRUMENT][:, :3] if INSTRUMENT in twists else read


@dataclass(frozen=True)
class Loads:
    """Gravity loads on the arm, in newton metres and newtons.

    torque: (N, n) about each joint axis, the force along it where the joint slides.  moments: (n + 1, N, 3) about each
    frame's origin, in that frame's axes, of all that this frame carries (index 0: the base).
    """

    torque: Array
    moments: Array


def gravity_loads(arm: Arm, q: Array, payload: Array | None = None, tool: Array | None = None) -> Loads:
    """Sum of lever arm x weight over every link beyond a joint, and of the payload at the tool point."""
    placed = frames(arm, q)
    masses = [np.full(len(q), m) for m in arm.masses]
    centres = [placed[i + 1][:, :3, :3] @ c + placed[i + 1][:, :3, 3] for i, c in enumerate(arm.centres)]
    if payload is not None:
        point = np.zeros(3) if tool is None else tool
        masses.append(payload)
        centres.append(placed[-1][:, :3, :3] @ point + placed[-1][:, :3, 3])
    moments = np.zeros((len(arm.rows) + 1, len(q), 3))
    torque = np.zeros((len(q), len(arm.rows)))
    for slot in range(len(arm.rows) + 1):
        origin = placed[slot][:, :3, 3]
        total = np.zeros((len(q), 3))
        for link in range(max(slot - 1, 0), len(masses)):
            total += np.cross(centres[link] - origin, masses[link][:, None] * GRAVITY)
        moments[slot] = np.einsum("nji,nj->ni", placed[slot][:, :3, :3], total)
        if slot in arm.prismatic:
            torque[:, slot - 1] = sum(masses[slot - 1 :]) * (placed[slot][:, :3, 2] @ GRAVITY)
        elif slot:
            torque[:, slot - 1] = moments[slot][:, 2]
    return Loads(torque, moments)


def weight_regressor(arm: Arm, q: Array, joint: int) -> Array:
    """(N, 3 (n - joint + 1)) torque about a joint of unit mass moments, fixed in each frame from the joint on.

    z_j . (R_i e_a x g), i = j..n, a = x, y, z: gravity torque is linear in them whatever the masses and their centres,
    since every lever arm is a sum of vectors that are constant in the frames between.  Prismatic joints excluded.
    """
    placed = frames(arm, q)[:, :, :3, :3]
    axis = placed[joint][:, :, 2]
    blocks = [np.einsum("nk,nak->na", axis, np.cross(r.transpose(0, 2, 1), GRAVITY)) for r in placed[joint:]]
    return np.hstack(blocks)


def above_floor(arm: Arm, q: Array) -> NDArray[np.bool_]:
    """(N,) whether the flange is over the floor."""
    return np.asarray(frames(arm, q)[-1][:, 2, 3] > FLOOR)


def draw_poses(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """(count, n) joint values, uniform within the limits, with the flange above the floor."""
    kept = np.empty((0, len(arm.rows)))
    while len(kept) < count:
        q = rng.uniform(arm.limits[:, 0], arm.limits[:, 1], (count - len(kept), len(arm.rows)))
        kept = np.vstack([kept, q[above_floor(arm, q)]])
    return kept
