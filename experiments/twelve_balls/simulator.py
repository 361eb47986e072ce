"""Simulate a hexapod and a Tau robot with one ball out of round, without code of gpmodel.

The description of a machine is read from its TOML file, its loops are closed by SciPy. A ball with lobes lifts its link
by `LIFT` cos(3 angle + phase); the angle is how far the link has turned in that socket from where it stands at home.
"""

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from experiments.blind.simulator import Array

LIFT, LOBES, GEOMETRY, DIRECTION = 12e-6, 3, 1e-4, 1e-4
"""m; a turn; m of every ball centre, length and axis; rad of the axes."""

POINT_NOISE, TURN_NOISE = 2e-6, 5e-6
ARMS = np.array([0, 0, 0, 1, 1, 2])
BALLS = tuple(f"L{link}.{end}" for link in range(1, 7) for end in ("fixed", "platform"))
REACH, TILT, HEIGHT = np.array([0.2, 0.2, 0.12]), np.radians(15.0), 0.4
"""Reach, tilt and height of the hexapod's platform, m and rad."""


def length(text: str) -> float:
    """ "12 mm" in m, "3 deg" in rad."""
    value, name = text.split()
    return float(value) * {"mm": 1e-3, "deg": np.pi / 180.0}[name]


@dataclass(frozen=True)
class Fault:
    """ball: number in BALLS, or -1 for none. axis: 0 for roll, 1 for pitch."""

    ball: int
    axis: int
    phase: float

    @property
    def angle(self) -> str:
        """The column that the product calls it by."""
        return f"{BALLS[self.ball].replace('.', '_')}_{('roll', 'pitch')[self.axis]}"


def standing(home: Array) -> Rotation:
    """The smallest turn of z to a direction."""
    axis = np.cross([0.0, 0.0, 1.0], home)
    return Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.arccos(home[2] / np.linalg.norm(home)))


def tilt(along: Array, home: Array, axis: int) -> Array:
    """Roll or pitch (N,) of directions (N, 3) in the axes of a socket."""
    u = standing(home).inv().apply(along / np.linalg.norm(along, axis=-1, keepdims=True))
    return np.arctan2(-u[:, 1], u[:, 2]) if axis == 0 else np.arcsin(u[:, 0])


@dataclass(frozen=True)
class Legs:
    """Six links at poses. lower, upper: (6, 3) m of the balls in what carries them. turn: of the carriers (6, N) and of
    the platform (N,). at: (6, N, 3) m of the carriers."""

    lower: Array
    upper: Array
    carriers: list[Rotation]
    at: Array

    def feet(self) -> Array:
        """The lower balls (6, N, 3), m."""
        return np.stack([c.apply(b) for c, b in zip(self.carriers, self.lower, strict=True)]) + self.at

    def vectors(self, place: Array, turn: Rotation) -> Array:
        """From the lower to the upper balls (6, N, 3), m."""
        return np.stack([turn.apply(ball) for ball in self.upper]) + place - self.feet()

    def lift(self, fault: Fault, home: Array, place: Array, turn: Rotation) -> Array:
        """Return the lengthening (6, N) of a link by the bad ball, m; home: vectors (12, 3) at home in the sockets'
        axes.
        """
        out = np.zeros((6, len(place)))
        if fault.ball >= 0:
            link, end = divmod(fault.ball, 2)
            socket = turn if end else self.carriers[link]
            along = socket.inv().apply(self.vectors(place, turn)[link])
            out[link] = LIFT * np.cos(LOBES * tilt(along, home[fault.ball], fault.axis) + fault.phase)
        return out


def hexapod_readings(file: Path, fault: Fault, count: int, rng: np.random.Generator) -> tuple[Array, Array, Rotation]:
    """Return the encoder readings (N, 6), m, place (N, 3), m, and rotation of the platform: poses first, then
    lengths.
    """
    told = tomllib.loads(file.read_text(encoding="utf-8"))
    stroke = [length(told["leg"][end]) for end in ("shortest", "longest")]
    half = np.pi / 3 - length(told["platform"]["pair"]) / 2
    pair = length(told["base"]["pair"]) / 2
    rings = [
        (length(told[part]["radius"]), np.add.outer(np.radians([0.0, 120.0, 240.0]), angles).ravel())
        for part, angles in (("base", (-pair, pair)), ("platform", (-half, half)))
    ]
    lower, upper = (r * np.column_stack([np.cos(a), np.sin(a), np.zeros(6)]) for r, a in rings)
    apart = np.linalg.norm(upper - lower, axis=1).mean()
    high = np.sqrt(np.mean(stroke) ** 2 - apart**2)
    home = np.repeat(upper + np.array([0.0, 0.0, high]) - lower, 2, axis=0)
    tried = rng.uniform(-1.0, 1.0, (40 * count, 6))
    place, turn = np.array([0.0, 0.0, HEIGHT]) + REACH * tried[:, :3], Rotation.from_rotvec(TILT * tried[:, 3:])
    off = GEOMETRY * rng.normal(size=(13, 6))
    still = [Rotation.identity(1)] * 6
    legs = Legs(lower + off[:6, :3], upper + off[6:12, :3], still, np.zeros((6, 1, 3)))
    read = np.linalg.norm(legs.vectors(place, turn), axis=2) - legs.lift(fault, home, place, turn) - off[12][:, None]
    kept = np.flatnonzero(((read > stroke[0]) & (read < stroke[1])).all(axis=0))[:count]
    return read[:, kept].T, place[kept], turn[kept]


def tau_readings(file: Path, fault: Fault, count: int, rng: np.random.Generator) -> tuple[Array, Array, Rotation]:
    """Return the readings of the Tau robot: coordinates first, then the pose that closes its loops."""
    told = tomllib.loads(file.read_text(encoding="utf-8"))
    arms, links = told["actuator"], told["link"]
    lower, upper = (np.array([[length(v) for v in link[end]] for link in links]) for end in ("base", "platform"))
    at = np.array([[length(v) for v in arm["at"]] for arm in arms])
    stands = np.array([length(arm["stands"]) for arm in arms])
    start = np.array([length(v) for v in told["start"]])
    limits = np.array([[length(v) for v in arm["turn"]] for arm in arms])
    q = rng.uniform(*limits.T, (count, 3))

    def carried(angles: Array, tipped: Array, at: Array, lower: Array, upper: Array) -> Legs:
        turns = [
            Rotation.from_rotvec(tipped[a]) * Rotation.from_rotvec(angles[:, a, None] * [0.0, 0.0, 1.0]) for a in ARMS
        ]
        return Legs(lower, upper, turns, at[ARMS][:, None] + np.zeros((6, len(angles), 3)))

    nominal = carried(stands[None], np.zeros((3, 3)), at, lower, upper)
    first = nominal.vectors(start[None], Rotation.identity(1))[:, 0]
    home = np.stack([(c.inv().apply(v)[0], v) for c, v in zip(nominal.carriers, first, strict=True)]).reshape(12, 3)
    legs = carried(
        q + stands, DIRECTION * rng.normal(size=(3, 3)), at + GEOMETRY * rng.normal(size=(3, 3)),
        lower + GEOMETRY * rng.normal(size=(6, 3)), upper + GEOMETRY * rng.normal(size=(6, 3)),
    )  # fmt: skip
    long = np.linalg.norm(first, axis=1) + GEOMETRY * rng.normal(size=6)
    pose = np.empty((count, 6))
    for k in range(count):
        one = Legs(legs.lower, legs.upper, [c[k : k + 1] for c in legs.carriers], legs.at[:, k : k + 1])

        def gaps(x: Array, one: Legs = one) -> Array:
            place, turn = x[None, :3], Rotation.from_rotvec(x[None, 3:])
            return 1e3 * (
                np.linalg.norm(one.vectors(place, turn), axis=2)[:, 0] - long - one.lift(fault, home, place, turn)[:, 0]
            )

        found = root(gaps, np.concatenate([start, np.zeros(3)]), tol=1e-12)
        if np.abs(found.fun).max() > 1e-6:
            raise ArithmeticError(f"pose {k} does not close: {found.message}")
        pose[k] = found.x
    return q, pose[:, :3], Rotation.from_rotvec(pose[:, 3:])


MACHINES = {
    "hexapod": (Path(__file__).parent / "hexapod.toml", hexapod_readings),
    "tau": (Path(__file__).parents[2] / "joints" / "data" / "tau.toml", tau_readings),
}


TURNED = {"tau": (1, 0, 1, 0, 1, 0, 1, 1, 1, 1, 0, 0)}
"""Flag for each ball that its lobes show in roll or in pitch; on the hexapod both show."""


def drawn(kind: str, seed: int, planted: bool) -> tuple[Fault, np.random.Generator]:
    """The bad ball of machine `seed`, and the generator of all the rest."""
    rng = np.random.default_rng([2003, seed, planted])
    ball, axis, phase = int(rng.integers(12)), int(rng.integers(2)), float(rng.uniform(0.0, 2.0 * np.pi))
    return (Fault(ball, TURNED[kind][ball] if kind in TURNED else axis, phase) if planted else Fault(-1, 0, 0.0)), rng


def table(kind: str, seed: int, planted: bool, count: int, noise: bool = True, poses: int = 0) -> tuple[str, Fault]:
    """A measured table as the text of a CSV file, and the fault. noise: without it, what is there. poses: a number of
    further poses of the same machine."""
    fault, rng = drawn(kind, seed, planted)
    file, readings = MACHINES[kind]
    tool = np.array([length(v) for v in tomllib.loads(file.read_text(encoding="utf-8"))["tool"]["centre"]])
    instrument, origin = Rotation.from_rotvec(rng.uniform(-1.5, 1.5, 3)), rng.normal(0.0, 2.0, 3)
    read, place, turn = readings(file, fault, count + poses, rng)
    point = instrument.apply(turn.apply(tool) + place) + origin
    seen = instrument * turn
    if noise:
        errors = np.random.default_rng([2004, seed, planted])
        point = point + errors.normal(0.0, POINT_NOISE, point.shape)
        seen = Rotation.from_rotvec(errors.normal(0.0, TURN_NOISE, point.shape)) * seen
    columns = [f"L{i} [mm]" for i in range(1, 7)] if kind == "hexapod" else [f"A{i} [rad]" for i in range(1, 4)]
    names = [*columns, "x [mm]", "y [mm]", "z [mm]", "rx [rad]", "ry [rad]", "rz [rad]"]
    rows = np.hstack([read * (1e3 if kind == "hexapod" else 1.0), 1e3 * point, seen.as_rotvec()])
    return "\n".join([",".join(names), *(",".join(f"{v:.12g}" for v in row) for row in rows)]) + "\n", fault
