"""A platform on six links with a ball joint at either end: closure of its loops, for any drive of the links.

|p + R (b_i + δb_i) - (a_i + δa_i)| = l_i + δl_i,   i = 1..6

p, R: position and rotation of the platform; a, b: balls at the foot of a link and on the platform; l: length of a link;
δ: errors of positions and lengths. Source: Merlet 2006, Parallel Robots, chapters 4 (Newton's method) and 5 (Jacobian).
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import ClassVar, TypeVar

import numpy as np

from gpmodel.arrays import Array, Mask
from gpmodel.errors import InputError, OpenLoopsError
from gpmodel.mechanism.protocol import AXES, GRAVITY, Ball, Joint, Shift
from gpmodel.numerics import se3
from joints.settings import Settings, laid_over, read_toml

STEPS = 50
"""Largest number of Newton steps for the platform's pose. Each Newton step doubles the number of correct digits.
A machine whose pose needs more steps cannot close its loops."""

PROGRESS, STALLED = 0.9, 6
"""Newton's method ends without success after 6 steps (STALLED) in which the largest gap of a link does not fall by a
tenth (PROGRESS). With half as many steps, none of 2161 poses with tilts up to 15 deg is lost and one of 671 at 45 deg;
with twice as many, a pose that cannot close takes twice the time."""

CLOSED = 1e-13
"""Largest gap of a closed kinematic loop, m. Rounding of a length of a metre is a few 1e-16 m."""

LONGEST_STEP = 0.1
"""Longest step of Newton's method, m and rad. A short step keeps the machine in its assembly mode."""


def newton(pose: Array, lower: Array, balls: Array, lengths: Array) -> tuple[Array, Array]:
    """Find the poses (poses, 4, 4) of a platform by Newton's method; return also the largest gap of a link per pose, m.

    pose: initial poses (poses, 4, 4) of the platform.
    lower: centres (6, poses, 3) of the lower balls, m. balls: centres (6, poses, 3) of the upper balls in the
    platform's frame, m. lengths: lengths (6, poses) of the links, m.
    Newton's steps end when the loops are closed or the gap has stopped falling.
    """
    pose, lower, balls, lengths = pose.copy(), *(np.swapaxes(part, 0, 1) for part in (lower, balls, lengths))
    miss, best, stalled = np.full(len(pose), np.inf), np.full(len(pose), np.inf), np.zeros(len(pose), dtype=int)
    rows = np.arange(len(pose))
    for _ in range(STEPS):
        turn, at = pose[rows, :3, :3], pose[rows, :3, 3]
        vectors = balls[rows] @ np.swapaxes(turn, 1, 2) + (at[:, None] - lower[rows])
        long = np.sqrt(np.einsum("nki,nki->nk", vectors, vectors))
        short = lengths[rows] - long
        miss[rows] = np.abs(short).max(axis=1)
        stalled[rows] = np.where(miss[rows] < PROGRESS * best[rows], 0, stalled[rows] + 1)
        best[rows] = np.minimum(best[rows], miss[rows])
        go = np.flatnonzero((miss[rows] >= CLOSED) & (stalled[rows] < STALLED))
        if not len(go):
            break
        rows = rows[go]
        along = (vectors[go] / long[go, :, None]) @ turn[go]
        try:
            step = np.linalg.solve(wrenches(along, balls[rows]), short[go, :, None])[:, :, 0]
        except np.linalg.LinAlgError:
            break
        longest = np.abs(step).max(axis=1, keepdims=True)
        pose[rows] = pose[rows] @ se3.exp(step * (LONGEST_STEP / np.maximum(longest, LONGEST_STEP)))
    return pose, miss


def wrenches(along: Array, arm: Array) -> Array:
    """Return rows (..., 6): a unit direction u (..., 3), and its moment r × u with the lever arm r (..., 3)."""
    (x, y, z), (u, v, w) = np.moveaxis(arm, -1, 0), np.moveaxis(along, -1, 0)
    return np.stack([u, v, w, y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def jacobian_of(tool: Array, lower: Array, upper: Array) -> Array:
    """Return the derivatives (poses, 6, 6) of the six link lengths with respect to a twist of the tool, in the tool
    frame. A link's row is (u, r × u): unit vector u along the link, vector r from the tool to the link's upper ball."""
    turn = tool[:, :3, :3]
    along = np.einsum("nji,knj->nki", turn, unit(upper - lower))
    arm = np.einsum("nji,knj->nki", turn, upper - tool[:, :3, 3])
    return wrenches(along, arm)


def unit(vectors: Array) -> Array:
    """Scale vectors (..., 3) to length one."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def axes_along(directions: Array) -> Array:
    """Return the smallest rotations (..., 3, 3) that turn the z axis onto unit vectors (..., 3). A unit vector
    along -z has no smallest rotation and is not allowed."""
    v = np.stack([-directions[..., 1], directions[..., 0], np.zeros(directions.shape[:-1])], axis=-1)
    turn = se3.hat(v.reshape(-1, 3)).reshape(*directions.shape, 3)
    return np.eye(3) + turn + turn @ turn / (1.0 + directions[..., 2])[..., None, None]


def adjoint(frame: Array) -> Array:
    """Return the matrices (poses, 6, 6) that convert twists in one frame to twists in the axes of a body.
    frame: pose (poses, 4, 4) of the first frame in the frame of the body."""
    out = np.zeros((len(frame), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = frame[:, :3, :3]
    out[:, :3, 3:] = se3.hat(frame[:, :3, 3]) @ frame[:, :3, :3]
    return out


LEGS = 6
WEAKEST = 1e-3
"""Least singular value of the legs' Jacobian at home, with lengths relative to the platform's radius. With a smaller
singular value the legs do not hold the platform; two similar hexagons have the value zero."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SixLegged:
    """A machine with six links between a base and a platform.

    Slots (frames at which errors act): the base, the slots that move the links, the lower ball, link and upper ball of
    each link, and the measured frame on the platform.
    first: index of the first slot of the links in `slots`.
    axial: name of the force along link i; `{i}` stands for its number.
    base, platform: nominal centres (6, 3) of the balls at the feet of the links and on the platform, m.
    tool: measured point (3,) on the platform, m.
    mass: mass of the platform, kg, at the origin of the platform.
    gravity: acceleration of gravity (3,), m/s², in the base frame.
    payload_com: centre of mass (3,) of a payload in the measured frame, m.
    """

    first: ClassVar[int] = 1
    axial: ClassVar[str] = "force_L{i}_z"
    name: str
    base: Array
    platform: Array
    tool: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mass: float = 0.0
    gravity: tuple[float, float, float] = (0.0, 0.0, -GRAVITY)
    payload_com: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    @abstractmethod
    def joints(self) -> tuple[Joint, ...]:
        """Measured joints of the machine with six links."""

    @property
    @abstractmethod
    def slots(self) -> tuple[str, ...]:
        """Names of the machine's frames (slots) at which errors act, in order from base to tool."""

    @abstractmethod
    def feet(self, frames: Array, own: Array, q: Array) -> tuple[Array, Array]:
        """Write the poses of all slots up to the lower balls into `frames` (slots, poses, 4, 4).
        own: error transform of each frame (slot). q: joint values. Returns the link lengths (6, poses), m, without the
        errors of the links, and an initial pose (poses, 4, 4) of the platform."""

    @property
    @abstractmethod
    def home(self) -> Array:
        """Home pose: joint values (1, joints) in the middle of the workspace, rad or m."""

    @cached_property
    def link_slots(self) -> tuple[str, ...]:
        """Names of the slots (frames at which errors act) of every leg: lower ball, leg, upper ball."""
        return tuple(f"L{i}.{part}" for i in range(1, LEGS + 1) for part in ("fixed", "moving", "platform"))

    @property
    def link_constants(self) -> tuple[tuple[str, str], ...]:
        """Geometric constants (frame, axis): length of each link, then the coordinates of the centres of its balls."""
        legs = range(1, LEGS + 1)
        balls = ((f"L{i}.{ball}", axis) for i in legs for ball in ("fixed", "platform") for axis in AXES[:3])
        return (*((f"L{i}.moving", "Tz") for i in legs), *balls)

    def link_levers(self, lengths: Array) -> dict[str, Array]:
        """Return {frame: vector (3,) [m] that grows with temperature}: positions of the balls, and links of the given
        lengths."""
        out = {}
        for i, (base, platform, length) in enumerate(zip(self.base, self.platform, lengths, strict=True), 1):
            out[f"L{i}.fixed"], out[f"L{i}.platform"] = base, platform
            out[f"L{i}.moving"] = np.array([0.0, 0.0, length])
        return out

    @cached_property
    def balls(self) -> tuple[Ball, ...]:
        """The twelve balls, named by frames (slots), with angles as in the joint of the thesis. At home the axis of
        each ball is along its link."""
        out = []
        for i in range(1, LEGS + 1):
            for end in ("fixed", "platform"):
                shifts: dict[str, Shift] = {f"along {a} of L{i}.{end}": ((f"L{i}.{end}", f"T{a}", 1.0),) for a in "zxy"}
                shifts[f"along L{i}"] = ((f"L{i}.moving", "Tz", 1.0),)
                angles = (f"L{i}_{end}_roll", f"L{i}_{end}_pitch")
                out.append(Ball(f"L{i}.{end}", angles, shifts, self.axial.format(i=i)))
        return tuple(out)

    def turned(self, q: Array) -> dict[str, Array]:
        """Return roll and pitch [rad] of every ball: Rx(roll) Ry(pitch) turns z of the socket along the link."""
        there, home = self._along(self.assembled(q, {})), self._along(self.assembled(self.home, {}))
        u = np.einsum("enij,enj->eni", np.swapaxes(axes_along(home), 2, 3) + np.zeros((1, len(q), 1, 1)), there)
        angles = np.stack([np.arctan2(-u[..., 1], u[..., 2]), np.arcsin(np.clip(u[..., 0], -1.0, 1.0))])
        names = np.array([ball.angles for ball in self.balls])
        return {str(names[k, a]): angles[a, k] for k in range(len(names)) for a in range(2)}

    def _along(self, frames: Array) -> Array:
        """Return the directions (12, poses, 3) of the links in the axes of the sockets at both of their ends."""
        lower, upper = frames[self.first : -1 : 3], frames[self.first + 2 : -1 : 3]
        along = unit(upper[..., :3, 3] - lower[..., :3, 3])
        seen = [np.einsum("knji,knj->kni", frame[..., :3, :3], along) for frame in (lower, upper)]
        return np.stack(seen, axis=1).reshape(2 * LEGS, -1, 3)

    def transforms(self, q: Array) -> Array:
        """Return nominal transforms (slots, poses, 4, 4) between successive frames (slots), m.
        Raises InputError if a closed loop cannot be closed."""
        frames = self.assembled(q, {})
        out = np.linalg.inv(np.concatenate([np.eye(4) + np.zeros_like(frames[:1]), frames[:-1]])) @ frames
        out[..., 3, :] = (0.0, 0.0, 0.0, 1.0)
        return out

    def assembled(self, q: Array, twists: Mapping[int, Array]) -> Array:
        """Return the poses (slots, poses, 4, 4) of all frames, m, with their error twists and with all loops closed."""
        frames, lengths, miss = self._solved(q, twists)
        wrong = int(np.argmax(miss))
        if not miss[wrong] < CLOSED:
            said = ", ".join(f"{1e3 * v:.1f}" for v in lengths[:, wrong])
            raise OpenLoopsError(f"legs of {said} mm do not meet in one platform of {self.name}", wrong)
        return frames

    def closes(self, q: Array, twists: Mapping[int, Array] | None = None) -> Mask:
        """Return for each pose whether the links meet in one platform (loops closed).
        q: joint values (poses, joints). twists: error twist (poses, 6) of each frame (slot)."""
        return self._solved(q, twists or {})[2] < CLOSED

    def _solved(self, q: Array, twists: Mapping[int, Array]) -> tuple[Array, Array, Array]:
        """Return slot poses (slots, poses, 4, 4), link lengths (6, poses) and the largest gap (poses,) of a link, m."""
        q, at = self.values(q), self.first
        own = np.broadcast_to(np.eye(4), (len(self.slots), len(q), 4, 4)).copy()
        for slot, twist in twists.items():
            own[slot] = se3.exp(twist)
        frames = own.copy()
        lengths, pose = self.feet(frames, own, q)
        lengths = lengths + own[at + 1 : -1 : 3, :, 2, 3]
        balls = se3.shift(self.platform)[:, None] @ own[at + 2 : -1 : 3]
        lower = frames[at:-1:3, :, :3, 3]
        pose, miss = newton(pose, lower, balls[..., :3, 3], lengths)
        frames[at + 2 : -1 : 3] = pose @ balls
        upper = frames[at + 2 : -1 : 3, :, :3, 3]
        frames[at + 1 : -1 : 3, :, :3, 3] = upper
        frames[at + 1 : -1 : 3, :, :3, :3] = axes_along(unit(upper - lower)) @ own[at + 1 : -1 : 3, :, :3, :3]
        frames[-1] = pose @ se3.shift(self.tool) @ own[-1]
        return frames, lengths, miss

    def carried(self, frames: Array, slot: int) -> Array:
        """Return the twist of the tool per unit error twist at a frame (slot), (poses, 6, 6). The twist ζ of the tool
        solves J ζ + c = 0, with the change J ζ of the link lengths by ζ and their change c by the error at the slot."""
        tool = frames[-1]
        if slot == len(frames) - 1:
            return np.broadcast_to(np.eye(6), (len(tool), 6, 6))
        if slot == 0:
            return adjoint(np.linalg.inv(tool) @ frames[0])
        lower, upper = frames[self.first : -1 : 3, :, :3, 3], frames[self.first + 2 : -1 : 3, :, :3, 3]
        changed = np.zeros((len(tool), LEGS, 6))
        leg, part = divmod(slot - self.first, 3)
        along = np.einsum("kni,nij->knj", unit(upper - lower), frames[slot, :, :3, :3])
        if slot < self.first:
            arm = np.einsum("kni,nij->knj", lower - frames[slot, :, :3, 3], frames[slot, :, :3, :3])
            of_arm = self.links_behind(slot)
            changed[:, of_arm] = np.concatenate([along, np.cross(arm, along)], axis=2)[of_arm].swapaxes(0, 1)
        else:
            changed[:, leg, :3] = (-1.0 if part == 2 else 1.0) * along[leg]
        return np.linalg.inv(self.jacobian(frames)) @ changed

    def links_behind(self, slot: int) -> list[int]:
        """Return the indices (from 0) of the links that a frame (slot) before the links moves."""
        return []

    def jacobian(self, frames: Array) -> Array:
        """Return the derivatives (poses, 6, 6) of the link lengths with respect to a twist of the tool, in the tool
        frame."""
        return jacobian_of(frames[-1], frames[self.first : -1 : 3, :, :3, 3], frames[self.first + 2 : -1 : 3, :, :3, 3])

    def weakest(self, q: Array) -> Array:
        """Return the smallest singular value of the links' Jacobian at each pose; zero at a singular pose. In the
        Jacobian, rotations are multiplied by the platform's radius."""
        jacobian = self.jacobian(self.assembled(q, {}))
        jacobian[:, :, 3:] /= np.linalg.norm(self.platform, axis=1).mean()
        return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[:, -1])

    def weight(self, frames: Array, payload: Array) -> tuple[Array, dict[str, Array]]:
        """Return the force [N] of the weight on each link (poses, 6), and forces and moments on the base by name."""
        tool, down = frames[-1], np.asarray(self.gravity)
        turn = tool[:, :3, :3]
        arms = np.stack([turn @ np.asarray(self.payload_com), -turn @ np.asarray(self.tool)])
        forces = np.stack([payload[:, None] * down, np.broadcast_to(self.mass * down, (len(tool), 3))])
        force, moment = forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)
        wrench = np.einsum("nji,knj->nki", turn, np.stack([force, moment])).reshape(len(tool), 6)
        legs = np.linalg.solve(np.swapaxes(self.jacobian(frames), 1, 2), wrench[:, :, None])[:, :, 0]
        out: dict[str, Array] = {}
        for kind, values in (("force", force), ("moment", moment + np.cross(tool[:, :3, 3], force))):
            out |= {f"{kind}_base_{axis}": values[:, k] for k, axis in enumerate("xyz")}
        return legs, out

    def values(self, q: Array) -> Array:
        """Return joint values (poses, joints) as numbers. Raises InputError unless the array has one column per
        joint."""
        q = np.asarray(q, dtype=float)
        if q.ndim != 2 or q.shape[1] != len(self.joints):
            names = f"{self.joints[0].name} to {self.joints[-1].name}"
            raise InputError(
                f"{self.name}: joint values of shape {q.shape}, expected (poses, {len(self.joints)}) for {names}"
            )
        return q


Machine = TypeVar("Machine", bound=SixLegged)


def from_settings(kind: str, path: Path | None, build: Callable[[Settings, str], Machine]) -> Machine:
    """Build a machine from the settings of a TOML file; without a file, the built-in machine.

    A machine without a name gets the TOML file's name. build: function that returns the machine from settings and a
    file name for messages.
    """
    given, file = (read_toml(path), path.name) if path else ({}, f"{kind}.toml")
    machine = build(laid_over(kind, given, file), file)
    return replace(machine, name=path.stem) if path and "name" not in given else machine


def with_supported_home(machine: Machine, file: str) -> Machine:
    """Return the machine, after a check that its legs hold the platform at the home pose.

    Raises InputError if the links do not meet at home, or if the Jacobian's smallest singular value is below WEAKEST.
    """
    try:
        weakest = float(machine.weakest(machine.home)[0])
    except InputError as error:
        raise InputError(f"{file}: {error}; expected longer legs or smaller rings") from None
    if weakest < WEAKEST:
        raise InputError(
            f"{file}: at half stroke the legs do not fix the platform; expected different rings at base and platform"
        )
    return machine
