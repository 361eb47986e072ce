"""Simulate effects of earlier poses: backlash, friction, warm-up.

The rows are in the order of measurement. The pose before the first row is unknown to oracle and user, who assume that
nothing had moved. Friction is at rest before the first row.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from experiments.blind.loads import largest_torque
from experiments.blind.shapes import RX, RY, Motion, Names, Shape, World, drive, fixed, mixed, turn
from experiments.blind.simulator import Arm, Array

WORDS = ("move", "last", "direction", "play", "stop", "hyster", "backlash", "approach")


def memory_names(joint: int) -> Names:
    """Columns of the history of a joint, however they are called."""
    return [[pattern] for word in WORDS for pattern in (f"*{word}*J{joint}*", f"J{joint}*{word}*")]


def direction(values: Array, before: float) -> Array:
    """(N,) sign of the last move to each row; kept where a joint stood still, zero where nothing moved yet."""
    sign = np.sign(np.diff(values, prepend=before))
    last = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))
    return np.asarray(sign[last])


def stop_operator(values: Array, radius: float) -> Array:
    """(N,) wound up within +-radius: e_k = clip(e_(k-1) + values_k - values_(k-1)), e_0 = 0; play is values - e.

    Source: Krasnosel'skii and Pokrovskii 1989; Brokate and Sprekels 1996, ch. 2.
    """
    out, wound, last = np.empty(len(values)), 0.0, values[0]
    for k, value in enumerate(values):
        wound = min(max(wound + value - last, -radius), radius)
        out[k], last = wound, value
    return out


def lag(values: Array, time: Array, tau: float) -> Array:
    """(N,) y of tau dy/dt = values - y, values straight between the rows, in equilibrium at the first row."""
    out = np.empty(len(values))
    out[0] = values[0]
    for k in range(1, len(values)):
        step = (time[k] - time[k - 1]) / tau
        decay = np.exp(-step)
        mean = (1.0 - decay) / step if step > 0 else 1.0
        out[k] = decay * out[k - 1] + (mean - decay) * values[k - 1] + (1.0 - mean) * values[k]
    return out


def last_move(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """Play of a drive: behind by half of it, on the side the joint came from."""
    axis = drive(arm, joint)
    shape = fixed(lambda w: turn(joint, direction(w.angle(joint), w.before(joint)), axis), memory_names(joint))
    return _called(shape, joint)


def hysteresis(arm: Arm, rng: np.random.Generator, joint: int, elements: int = 3) -> Shape:
    """Prandtl-Ishlinskii: a sum of stop operators with radii of 3 to 12 % of the joint's range, each over its own."""
    low, high = arm.limits[joint - 1]
    radii = (high - low) * np.linspace(0.03, 0.12, elements) * rng.uniform(0.8, 1.2, elements)
    weights = rng.dirichlet(np.full(elements, 2.0))

    def basis(w: World) -> list[Motion]:
        return [turn(joint, stop_operator(w.angle(joint), r) / r, drive(arm, joint)) for r in radii]

    shape = mixed(basis, weights, memory_names(joint), **{f"radius_{i}": float(r) for i, r in enumerate(radii)})
    return _called(shape, joint)


def friction_windup(arm: Arm, rng: np.random.Generator, joint: int) -> Shape:
    """Friction twists a drive against its last move, by a constant part and one in proportion to the load.

    direction * (c0 + c1 |gravity torque|); Source: Coulomb friction with a load-dependent part (Armstrong 1991).
    """
    share, most = rng.uniform(0.3, 0.7), largest_torque(arm, joint)

    def basis(w: World) -> list[Motion]:
        side = direction(w.angle(joint), w.before(joint))
        return [turn(joint, side), turn(joint, side * np.abs(w.torque(joint)) / most)]

    return _called(mixed(basis, np.array([1.0 - share, share]), memory_names(joint), share=share), joint)


def lagging_structure(arm: Arm, rng: np.random.Generator, joint: int, tau: float = 40.0, what: str = "grows") -> Shape:
    """A part follows the room's temperature, first order, tau in minutes: it grows along x, or tilts about x and y."""
    side = rng.uniform(0, 2 * np.pi)

    def basis(w: World) -> list[Motion]:
        warm = lag(w.extra["temperature"], w.extra["time"], tau) - 20.0
        return [turn(joint, warm, axis) for axis in ((0,) if what == "grows" else (RX, RY))]

    weights = np.ones(1) if what == "grows" else np.array([np.cos(side), np.sin(side)])
    names = [["*lag*"], ["temperature", "time"], ["temperature", "row"], ["temperature_*"]]
    shape = mixed(basis, weights, names, tau=tau)
    return Shape(shape.true, shape.basis, names, shape.constants, ["*lag*", "*follow*temperature*"])


def settling(arm: Arm, rng: np.random.Generator, joint: int, axis: int = 0) -> Shape:
    """After a stop at one moment of the session a part grows as 1 - exp(-(t - t0) / tau), t in minutes."""
    share, tau = rng.uniform(0.2, 0.4), rng.uniform(15.0, 30.0)

    def motion(w: World) -> Motion:
        time = w.extra["time"]
        since = time - (time[0] + share * (time[-1] - time[0]))
        return turn(joint, np.where(since > 0, 1.0 - np.exp(-np.maximum(since, 0.0) / tau), 0.0), axis)

    return fixed(motion, [["time"], ["row"], ["*since*"], ["*step*"]], share=share, tau=tau)


def _called(shape: Shape, joint: int) -> Shape:
    called = [f"*{word}*j{joint}*" for word in WORDS]
    return Shape(shape.true, shape.basis, shape.named, shape.constants, called)


KINDS: tuple[Callable[..., Shape], ...] = (last_move, hysteresis, friction_windup, lagging_structure, settling)
