"""A robot made of plain 4x4 products, for judging models it shares no code with.

Modified Denavit-Hartenberg rows (alpha, a, d, theta0) give the fixed placement of every joint,

    O_i = Rx(alpha) Tx(a) Tz(d) Rz(theta0),   p = G * prod_i [ E_(i-1) O_i Rz(q_i) ] * E_n * tool

with G the placement of the robot's base in the tracker, E_0 a small motion of the base and E_i a small motion of
the frame carried by joint i.  Gravity loads are sums of masses times lever arms.  Metres, radians, kilograms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, -9.80665])


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
    """rows: (n, 4) alpha, a, d, theta0 [rad, m]; limits: (n, 2) rad; masses: (n,) kg; centres: (n, 3) m, link frame."""

    name: str
    rows: Array
    limits: Array
    masses: Array
    centres: Array

    @property
    def joints(self) -> list[str]:
        return [f"J{i + 1}" for i in range(len(self.rows))]

    def origins(self) -> Array:
        """(n, 4, 4) placement of joint i at zero in the frame carried by joint i - 1."""
        return np.array([rotation_x(al) @ translation(a, 0, d) @ rotation_z(t) for al, a, d, t in self.rows])

    def heavier(self, factors: Array) -> Arm:
        """The same arm with other masses than its description says."""
        return replace(self, masses=self.masses * factors)


def frames(arm: Arm, q: Array, twists: dict[int, Array] | None = None) -> Array:
    """(n + 1, N, 4, 4) base and link frames in the nominal base; twists[slot] is (N, 6), slot 0 the base."""
    twists = twists or {}
    current = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    out = []
    for slot, origin in enumerate([None, *arm.origins()]):
        if origin is not None:
            current = current @ origin @ rotation_z(q[:, slot - 1])
        if slot in twists:
            current = current @ small_motion(twists[slot])
        out.append(current)
    return np.array(out)


def points(arm: Arm, q: Array, placement: Array, tool: Array, twists: dict[int, Array]) -> Array:
    """(N, 3) measured points in the tracker."""
    last = frames(arm, q, twists)[-1]
    in_base = last[:, :3, :3] @ tool + last[:, :3, 3]
    return in_base @ placement[:3, :3].T + placement[:3, 3]


@dataclass(frozen=True)
class Loads:
    """torque: (N, n) of gravity about each joint axis; moments: (n + 1, N, 3) about each frame's origin, in that
    frame's axes, of all that this frame carries (index 0: the base).  Newton metres, as gravity acts on the arm."""

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
    for slot in range(len(arm.rows) + 1):
        origin = placed[slot][:, :3, 3]
        total = np.zeros((len(q), 3))
        for link in range(max(slot - 1, 0), len(masses)):
            total += np.cross(centres[link] - origin, masses[link][:, None] * GRAVITY)
        moments[slot] = np.einsum("nji,nj->ni", placed[slot][:, :3, :3], total)
    return Loads(moments[1:, :, 2].T.copy(), moments)


def draw_poses(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """(count, n) joint angles, uniform within the limits, with the flange above the floor."""
    kept: list[Array] = []
    while len(kept) < count:
        q = rng.uniform(arm.limits[:, 0], arm.limits[:, 1])
        if frames(arm, q[None])[-1, 0, 2, 3] > 0.05:
            kept.append(q)
    return np.array(kept)


def rpy(rotation: Array) -> tuple[float, float, float]:
    """Fixed-axis roll, pitch, yaw of URDF: Rz(yaw) Ry(pitch) Rx(roll)."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return float(roll), float(pitch), float(yaw)


def urdf(arm: Arm) -> str:
    """The nominal arm as URDF: masses and centres of mass, no meshes, limits five degrees wider than the poses."""
    text = [f'<?xml version="1.0"?>\n<robot name="{arm.name}">\n  <link name="base"/>']
    for i, (mass, centre, origin) in enumerate(zip(arm.masses, arm.centres, arm.origins(), strict=True)):
        low, high = arm.limits[i] + np.radians([-5.0, 5.0])
        parent = "base" if i == 0 else f"link_{i}"
        xyz = " ".join(f"{v:.12g}" for v in origin[:3, 3])
        angles = " ".join(f"{v:.15g}" for v in rpy(origin[:3, :3]))
        inertia = 0.01 * mass
        text.append(
            f'  <link name="link_{i + 1}">\n    <inertial>\n'
            f'      <origin xyz="{centre[0]:.9g} {centre[1]:.9g} {centre[2]:.9g}" rpy="0 0 0"/>\n'
            f'      <mass value="{mass:.9g}"/>\n'
            f'      <inertia ixx="{inertia:.9g}" ixy="0" ixz="0" iyy="{inertia:.9g}" iyz="0" izz="{inertia:.9g}"/>\n'
            f"    </inertial>\n  </link>\n"
            f'  <joint name="J{i + 1}" type="revolute">\n'
            f'    <parent link="{parent}"/>\n    <child link="link_{i + 1}"/>\n'
            f'    <origin xyz="{xyz}" rpy="{angles}"/>\n    <axis xyz="0 0 1"/>\n'
            f'    <limit lower="{low:.9g}" upper="{high:.9g}" effort="1000" velocity="3"/>\n  </joint>'
        )
    return "\n".join([*text, "</robot>\n"])
