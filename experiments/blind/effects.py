"""Simulate errors of a blind robot, one effect per kind, inside and outside the catalogue."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from experiments.blind import axes, instrument, loads, memory
from experiments.blind.loads import largest_torque
from experiments.blind.shapes import RX, RZ, Motion, Shape, World, drive, fixed, load_names, mixed, turn
from experiments.blind.simulator import Arm, gravity_loads


def base_compliance(arm: Arm, rng: np.random.Generator) -> Shape:
    def motion(w: World) -> Motion:
        twist = np.zeros((len(w.q), 6))
        twist[:, RX:RZ] = w.loads.moments[0][:, :2]
        return {0: twist}

    return fixed(motion, [["moment_base_?"], ["moment_J1*"], ["J1", "J[23]"], ["J1", "torque_J[23]"]])


def compliance(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    return fixed(lambda w: turn(joint, w.torque(joint)), load_names(joint))


def cross_bending(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """Link beyond a joint bends about the x axis of its frame under the moment about that axis."""
    names = [
        [f"moment_J{joint}*"],
        [f"moment_J{joint + 1}*"],
        [f"torque_J{joint}"],
        [f"torque_J{joint + 1}"],
        ["J2", "J[3-5]"],
    ]
    return fixed(lambda w: turn(joint, w.loads.moments[joint][:, 0], RX), names)


def harmonic(arm: Arm, rng: np.random.Generator, joint: int, per_turn: float) -> Shape:
    phase = rng.uniform(0, 2 * np.pi)

    def basis(w: World) -> list[Motion]:
        angle = per_turn * w.angle(joint)
        return [turn(joint, np.sin(angle)), turn(joint, np.cos(angle))]

    return mixed(basis, np.array([np.cos(phase), np.sin(phase)]), [[f"J{joint}"]], phase=phase, per_turn=per_turn)


def coupling(arm: Arm, rng: np.random.Generator, source: int, joint: int) -> Shape:
    return fixed(lambda w: turn(joint, w.angle(source)), [[f"J{source}"]])


def gear_ratio(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """A joint moves a little more than it says: the gear's ratio, or the pitch of its screw."""
    return fixed(lambda w: turn(joint, w.angle(joint), drive(arm, joint)), [[f"J{joint}"]])


def thermal_link(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    return fixed(lambda w: turn(joint, w.extra["temperature"] - 20.0, 0), [["temperature"]])


def thermal_arm(arm: Arm, rng: np.random.Generator) -> Shape:
    """Every link grows along itself."""

    def motion(w: World) -> Motion:
        lengths = arm.origins()[:, :3, 3]
        warm = (w.extra["temperature"] - 20.0)[:, None]
        return {i: np.hstack([warm * length, np.zeros((len(w.q), 3))]) for i, length in enumerate(lengths)}

    return fixed(motion, [["temperature"]])


def warm_up(arm: Arm, rng: np.random.Generator, joint: int, by: str) -> Shape:
    """A link grows as 1 - exp(-t / tau), t the `time` column or the row."""
    tau = rng.uniform(0.15, 0.35)

    def motion(w: World) -> Motion:
        return turn(joint, 1.0 - np.exp(-(w.row if by == "row" else w.extra["time"] / 120.0) / tau), 0)

    return fixed(motion, [["row"]] if by == "row" else [["time"], ["row"]], tau=tau)


def drift(arm: Arm, rng: np.random.Generator) -> Shape:
    """The tracker creeps in one direction, in proportion to the row."""
    direction = rng.normal(size=3)

    def basis(w: World) -> list[Motion]:
        return [turn(0, w.row, axis) for axis in range(3)]

    return mixed(basis, direction / np.linalg.norm(direction), [["row"]])


def step(arm: Arm, rng: np.random.Generator, where: str) -> Shape:
    """The set-up (six numbers) or the tool (three) moves once, after a row in the middle half."""
    after = rng.uniform(0.3, 0.7)
    slot, axes = (0, 6) if where == "setup" else (len(arm.rows), 3)
    weights = rng.normal(size=axes) * np.array([1.0, 1.0, 1.0, 0.7, 0.7, 0.7])[:axes]

    def basis(w: World) -> list[Motion]:
        return [turn(slot, (w.row > after).astype(float), axis) for axis in range(axes)]

    return mixed(basis, weights, [["row"]], after=after)


def approach(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    return fixed(lambda w: turn(joint, w.extra[f"approach_J{joint}"]), [[f"approach_J{joint}"]])


def gravity_backlash(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    return fixed(lambda w: turn(joint, np.sign(w.torque(joint))), [*load_names(joint), [f"J{joint}"]])


def hardening(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """Stiffer under load: torque less forty per cent of its cube, on the scale of the arm's stretched torque."""
    scale = largest_torque(arm, joint)

    def basis(w: World) -> list[Motion]:
        load = w.torque(joint) / scale
        return [turn(joint, load), turn(joint, load**3)]

    return mixed(basis, np.array([1.0, -0.4]), load_names(joint), scale=scale)


def spring(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """A balancing spring that does not quite balance: sin(q + small angle)."""
    phase = rng.uniform(-0.4, 0.4)

    def basis(w: World) -> list[Motion]:
        return [turn(joint, np.sin(w.angle(joint))), turn(joint, np.cos(w.angle(joint)))]

    return mixed(basis, np.array([np.cos(phase), np.sin(phase)]), [[f"J{joint}"], [f"torque_J{joint}"]], phase=phase)


def payload_deflection(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """The controller allows for the arm's own weight, not for what it carries."""

    def motion(w: World) -> Motion:
        bare = gravity_loads(arm, w.q).torque[:, joint - 1]
        loaded = gravity_loads(arm, w.q, w.extra["payload"], w.tool).torque[:, joint - 1]
        return turn(joint, loaded - bare)

    return fixed(motion, [["payload"], [f"torque_J{joint}"]])


def bump(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """A worn spot: a Gaussian in one angle."""
    low, high = arm.limits[joint - 1]
    centre, width = low + (high - low) * rng.uniform(0.35, 0.65), (high - low) * rng.uniform(0.07, 0.11)
    return fixed(
        lambda w: turn(joint, np.exp(-0.5 * ((w.angle(joint) - centre) / width) ** 2)),
        [[f"J{joint}"]],
        centre=centre,
        width=width,
    )


def dead_zone(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    limit = 0.35 * largest_torque(arm, joint)
    return fixed(
        lambda w: turn(joint, np.sign(w.torque(joint)) * np.maximum(np.abs(w.torque(joint)) - limit, 0.0)),
        load_names(joint),
        limit=limit,
    )


def windup(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    scale = 0.25 * largest_torque(arm, joint)
    return fixed(lambda w: turn(joint, np.tanh(w.torque(joint) / scale)), load_names(joint), scale=scale)


def product(arm: Arm, rng: np.random.Generator, first: int, second: int, joint: int) -> Shape:
    def motion(w: World) -> Motion:
        return turn(joint, np.sin(2 * w.angle(first)) * np.cos(w.angle(second)))

    return fixed(motion, [[f"J{first}", f"J{second}"]])


def difference(arm: Arm, rng: np.random.Generator, first: int, second: int, joint: int) -> Shape:
    """A closing bar: the magnitude of the difference of two angles."""
    return fixed(lambda w: turn(joint, np.abs(w.angle(first) - w.angle(second))), [[f"J{first}", f"J{second}"]])


def curve(arm: Arm, rng: np.random.Generator, joint: int, harmonics: int = 10) -> Shape:
    """A smooth error curve of a drive: sines and cosines of 1 to `harmonics` turns, falling as one over the order."""
    orders = np.arange(1, harmonics + 1)
    weights = (rng.normal(size=(2, harmonics)) / orders).ravel()

    def basis(w: World) -> list[Motion]:
        return [turn(joint, wave(k * w.angle(joint))) for wave in (np.sin, np.cos) for k in orders]

    return mixed(basis, weights, [[f"J{joint}"]], harmonics=harmonics)


KINDS: dict[str, Callable[..., Shape]] = {
    make.__name__: make
    for make in (
        base_compliance, compliance, cross_bending, harmonic, coupling, gear_ratio, thermal_link, thermal_arm,
        warm_up, drift, step, approach, gravity_backlash, hardening, spring, payload_deflection, bump, dead_zone,
        windup, product, difference, curve, *memory.KINDS, *loads.KINDS, *axes.KINDS, *instrument.KINDS,
    )
}  # fmt: skip


def draw(kind: str, arm: Arm, rng: np.random.Generator, **settings: Any) -> Shape:
    return KINDS[kind](arm, rng, **settings)
