"""Six measured legs between two rings of ball joints: a Gough platform as a Mechanism with closed loops.

    |p + R (b_i + δb_i) - (a_i + δa_i)| = l_i + δl_i,   i = 1..6

Only the centres of the balls and the lengths matter: 6 x 7 constants, of which the places of base and platform take 12.
Sources: Gough and Whitehall 1962; Merlet 2006, Parallel Robots, ch. 4 (Newton's method) and 5 (Jacobian).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import AXES, Joint
from gpmodel.mechanism.quantities import GRAVITY
from gpmodel.numerics import se3

LEGS = 6
STEPS = 50
"""Newton's method doubles the digits a step; a machine that needs more than this does not close."""

CLOSED = 1e-13
"""m; a length of a metre is a root of squares that double precision resolves to 2e-16 each."""

LONGEST_STEP = 0.1
"""m and rad a step of Newton's method: part of the machine's size, so that it stays in the assembly it starts from."""


@dataclass(frozen=True, eq=False)
class Hexapod:
    """A platform on six legs with a ball joint at either end. A Mechanism; its loops close by Newton's method.

    base, platform: (6, 3) m, nominal centres of the balls in the frame of the base and of the platform. limits: m,
    shortest and longest leg. tool: (3,) m, the measured point on the platform. mass: kg of the platform, in its origin.
    gravity: (3,) m/s² in the base's frame. payload_com: (3,) m, centre of a payload in the measured frame.
    """

    base: Array
    platform: Array
    limits: tuple[float, float]
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mass: float = 0.0
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY)
    payload_com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    name: str = "hexapod"

    @cached_property
    def slots(self) -> tuple[str, ...]:
        """The base; of every leg its lower ball, the leg and its upper ball; the measured frame on the platform."""
        parts = (f"L{i}.{part}" for i in range(1, LEGS + 1) for part in ("fixed", "moving", "platform"))
        return ("base", *parts, "tool")

    @cached_property
    def joints(self) -> tuple[Joint, ...]:
        """L1 to L6: the lengths of the legs between the centres of their balls, measured."""
        return tuple(
            Joint(f"L{i}", "prismatic", *self.limits, ((f"L{i}.moving", "Tz", 1.0),)) for i in range(1, LEGS + 1)
        )

    @property
    def constants(self) -> tuple[tuple[str, str], ...]:
        """The length of each leg, then the centres of its balls, in the axes of base and platform."""
        legs = range(1, LEGS + 1)
        balls = ((f"L{i}.{ball}", axis) for i in legs for ball in ("fixed", "platform") for axis in AXES[:3])
        return (*((f"L{i}.moving", "Tz") for i in legs), *balls)

    @property
    def levers(self) -> dict[str, Array]:
        """Slot -> the vector (3,), m, that grows with temperature: the balls' places, and the legs at half stroke."""
        out = {}
        for i in range(LEGS):
            out[f"L{i + 1}.fixed"], out[f"L{i + 1}.platform"] = self.base[i], self.platform[i]
            out[f"L{i + 1}.moving"] = np.array([0.0, 0.0, np.mean(self.limits)])
        return out

    def transforms(self, q: Array) -> Array:
        """Nominal transforms (S, N, 4, 4) between successive slots, m. Raises InputError where loops do not close."""
        frames = self.assembled(q, {})
        out = np.linalg.inv(np.concatenate([np.eye(4) + np.zeros_like(frames[:1]), frames[:-1]])) @ frames
        out[..., 3, :] = (0.0, 0.0, 0.0, 1.0)
        return out

    def assembled(self, q: Array, twists: Mapping[int, Array]) -> Array:
        """Frames (S, N, 4, 4) of the slots, m, each after its error twist (N, 6), with all loops closed."""
        q = self._lengths(q)
        own = np.broadcast_to(np.eye(4), (len(self.slots), len(q), 4, 4)).copy()
        for slot, twist in twists.items():
            own[slot] = se3.exp(twist)
        frames = own.copy()
        frames[1:-1:3] = own[0] @ _shift(self.base)[:, None] @ own[1:-1:3]
        balls = _shift(self.platform)[:, None] @ own[3:-1:3]
        lower, lengths = frames[1:-1:3, :, :3, 3], q.T + own[2:-1:3, :, 2, 3]
        pose = self._closed(lower, balls[..., :3, 3], lengths)
        frames[3:-1:3] = pose @ balls
        frames[2:-1:3, :, :3, 3] = frames[3:-1:3, :, :3, 3]
        frames[2:-1:3, :, :3, :3] = _axes_along(_unit(frames[3:-1:3, :, :3, 3] - lower)) @ own[2:-1:3, :, :3, :3]
        frames[-1] = pose @ _shift(np.array(self.tool)) @ own[-1]
        return frames

    def carried(self, frames: Array, slot: int) -> Array:
        """Twist of the tool per unit twist at a slot, (N, 6, 6): with J ζ the change of the lengths by a twist ζ of the
        tool, c of them by the slot alone, J ζ + c = 0."""
        tool = frames[-1]
        if slot == len(self.slots) - 1:
            return np.broadcast_to(np.eye(6), (len(tool), 6, 6))
        if slot == 0:
            return _adjoint(np.linalg.inv(tool) @ frames[0])
        leg, part = divmod(slot - 1, 3)
        lower, upper = frames[1:-1:3, :, :3, 3], frames[3:-1:3, :, :3, 3]
        along = np.einsum("ni,nij->nj", _unit(upper[leg] - lower[leg]), frames[slot, :, :3, :3])
        gives = np.linalg.inv(_jacobian(tool, lower, upper))[:, :, leg]
        out = np.zeros((len(tool), 6, 6))
        out[:, :, :3] = (-1.0 if part == 2 else 1.0) * gives[:, :, None] * along[:, None, :]
        return out

    def loads(self, q: Array, payload: Array) -> dict[str, Array]:
        """torque_L1 .. (N): the force of the weight on each length; force_base_x .. moment_base_z: on the base."""
        carried = np.asarray(payload, dtype=float)
        if not np.any(carried) and not self.mass:
            return {}
        frames = self.assembled(q, {})
        tool, down = frames[-1], np.asarray(self.gravity)
        turn = tool[:, :3, :3]
        arms = np.stack([turn @ np.asarray(self.payload_com), -turn @ np.asarray(self.tool)])
        forces = np.stack([carried[:, None] * down, np.broadcast_to(self.mass * down, (len(q), 3))])
        force, moment = forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)
        wrench = np.einsum("nji,knj->nki", turn, np.stack([force, moment])).reshape(len(q), 6)
        jacobian = _jacobian(tool, frames[1:-1:3, :, :3, 3], frames[3:-1:3, :, :3, 3])
        legs = np.linalg.solve(np.swapaxes(jacobian, 1, 2), wrench[:, :, None])[:, :, 0]
        out = {f"torque_{joint.name}": legs[:, i] for i, joint in enumerate(self.joints)}
        for kind, values in (("force", force), ("moment", moment + np.cross(tool[:, :3, 3], force))):
            out |= {f"{kind}_base_{axis}": values[:, k] for k, axis in enumerate("xyz")}
        return out

    def weakest(self, q: Array) -> Array:
        """Smallest singular value (N,) of the legs' Jacobian, rotations times the platform's radius; zero: singular."""
        frames = self.assembled(q, {})
        jacobian = _jacobian(frames[-1], frames[1:-1:3, :, :3, 3], frames[3:-1:3, :, :3, 3])
        jacobian[:, :, 3:] /= np.linalg.norm(self.platform, axis=1).mean()
        return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[:, -1])

    def _lengths(self, q: Array) -> Array:
        q = np.asarray(q, dtype=float)
        if q.ndim != 2 or q.shape[1] != LEGS:
            raise InputError(f"{self.name}: joint values of shape {q.shape}, expected (poses, {LEGS}) for L1 to L6")
        return q

    def _closed(self, lower: Array, balls: Array, lengths: Array) -> Array:
        """Pose (N, 4, 4) of the platform: its balls (6, N, 3) at `lengths` (6, N) from the lower ones, from home on."""
        apart = np.linalg.norm((self.platform - self.base)[:, :2], axis=1).mean()
        pose = np.broadcast_to(np.eye(4), (lengths.shape[1], 4, 4)).copy()
        pose[:, 2, 3] = (
            np.sqrt(max(np.mean(self.limits) ** 2 - apart**2, 0.0)) + np.mean(self.base - self.platform, 0)[2]
        )
        miss = np.zeros_like(lengths)
        for _ in range(STEPS):
            upper = np.einsum("nij,knj->kni", pose[:, :3, :3], balls) + pose[:, :3, 3]
            miss = lengths - np.linalg.norm(upper - lower, axis=2)
            if np.abs(miss).max(initial=0.0) < CLOSED:
                return pose
            try:
                step = np.linalg.solve(_jacobian(pose, lower, upper), miss.T[:, :, None])[:, :, 0]
            except np.linalg.LinAlgError:
                break
            longest = np.abs(step).max(axis=1, keepdims=True)
            pose = pose @ se3.exp(step * np.minimum(1.0, LONGEST_STEP / np.maximum(longest, LONGEST_STEP)))
        wrong = int(np.abs(miss).max(axis=0).argmax())
        said = ", ".join(f"{1e3 * v:.1f}" for v in lengths[:, wrong])
        raise InputError(f"{self.name}: legs of {said} mm do not meet in one platform (pose {wrong + 1})")


def _jacobian(tool: Array, lower: Array, upper: Array) -> Array:
    """Change (N, 6, 6) of the lengths by a twist of the tool in its own frame: rows (u, r × u), u along the leg."""
    turn = tool[:, :3, :3]
    along = np.einsum("nji,knj->nki", turn, _unit(upper - lower))
    arm = np.einsum("nji,knj->nki", turn, upper - tool[:, :3, 3])
    return np.concatenate([along, np.cross(arm, along)], axis=2)


def _unit(vectors: Array) -> Array:
    out: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return out


def _shift(points: Array) -> Array:
    """Transforms (..., 4, 4) that move by points (..., 3)."""
    out = np.broadcast_to(np.eye(4), (*points.shape[:-1], 4, 4)).copy()
    out[..., :3, 3] = points
    return out


def _axes_along(directions: Array) -> Array:
    """Axes (..., 3, 3) with z along unit vectors (..., 3): the smallest turn of the root's; none points to -z."""
    v = np.stack([-directions[..., 1], directions[..., 0], np.zeros(directions.shape[:-1])], axis=-1)
    turn = se3.hat(v.reshape(-1, 3)).reshape(*directions.shape, 3)
    return np.eye(3) + turn + turn @ turn / (1.0 + directions[..., 2])[..., None, None]


def _adjoint(frame: Array) -> Array:
    """Twists (N, 6, 6) of a body in its own axes by those of another frame, placed at `frame` (N, 4, 4) in it."""
    out = np.zeros((len(frame), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = frame[:, :3, :3]
    out[:, :3, 3:] = se3.hat(frame[:, :3, 3]) @ frame[:, :3, :3]
    return out
