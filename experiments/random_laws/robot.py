"""Draw a robot with one undeclared formula, or with none, from a set of numbers."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from experiments.blind.arms import ARMS
from experiments.blind.case import Case
from experiments.blind.machine import Machine, stand
from experiments.blind.oracle import jacobian, left_by
from experiments.blind.robot import Sheet, world_of
from experiments.blind.session import Route, region, route, walk_noise
from experiments.blind.shapes import Motion, Shape, World
from experiments.blind.simulator import Array
from experiments.random_laws.law import GRAMMARS, Law, Place, drawn_law, places

RANGES = {"temperature": (18.0, 34.0), "time": (0.0, 120.0), "payload": (0.0, 10.0), "pressure": (4.0, 8.0)}
"""degC, min, kg, bar."""


def readings(names: list[str], count: int, rng: np.random.Generator) -> dict[str, Array]:
    """(count,) of each: times that only grow, a temperature in slow waves, a few payloads, a pressure at random."""
    out: dict[str, Array] = {}
    for name in names:
        low, high = RANGES[name]
        if name == "time":
            values = np.sort(rng.uniform(low, high, count))
        elif name == "temperature":
            wave = np.sin(2 * np.pi * (rng.uniform(1.2, 2.5) * np.linspace(0, 1, count) + rng.uniform()))
            values = (low + high) / 2 + 0.35 * (high - low) * wave + rng.normal(0, 0.12 * (high - low), count)
        elif name == "payload":
            values = rng.choice(np.linspace(low, high, 6), count)
        else:
            values = rng.uniform(low, high, count)
        out[name] = np.round(np.clip(values, low, high), 3)
    return out


FRESH, PROBE = 400, 300
MINIMUM_LEFT = 0.3
"""Share of its motion of the tool that a law has to leave after the geometric fit: of less nobody could tell."""
MINIMUM_SPREAD = 0.1
"""(mean x^2)^2 / mean x^4 of what is left, pose by pose: less would rest on a tenth of the poses."""
LARGEST = 5e-3
"""m or rad: no part of a machine moves by more without being noticed."""
DRIVES = 0.5
"""Share of the laws at a joint's own drive; the others are anywhere."""
TORQUES = 0.02, 1e-3
"""A torque is an input where its range is this share of the widest, and this many Nm."""
INNOCENT: dict[str, dict[str, Any]] = {
    "independent": {},
    "heavy tails": {"noise": "student"},
    "labelled repeats": {"repeats": 3, "labelled": True, "shared_mm": 0.04},
    "unlabelled repeats": {"repeats": 3, "shared_mm": 0.04},
    "walking tracker": {"walk_mm": 0.08},
    "few poses": {"poses": 40},
    "narrow": {"narrow": 0.2},
    "clusters": {"order": "clusters", "shared_mm": 0.02},
    "outliers": {"outliers": 0.02},
    "small moves": {"order": "walk"},
}


@dataclass(frozen=True)
class Robot:
    """machine: the real one; law, place, amount: of what nobody declared (none on an innocent robot); size_mm: the 3-D
    rms it leaves after a geometric fit; train and fresh: poses measured, and where they are."""

    kind: str
    machine: Machine
    law: Law | None
    place: Place | None
    amount: float
    size_mm: float
    train: Sheet
    fresh: Sheet


def is_aside(seed: int) -> bool:
    """Odd seeds are for a last look."""
    return seed % 2 == 1


def factors_of(text: str) -> list[int | str]:
    """Names of grammars, written with commas. Raises SystemExit for one that is not there."""
    named = {str(name): name for name in GRAMMARS}
    if unknown := [word for word in text.split(",") if word not in named]:
        raise SystemExit(f"--factors: {unknown[0]!r}, expected some of {','.join(named)}")
    return [named[word] for word in text.split(",")]


def make(seed: int, factors: int | str, index: int, size_mm: float | None = None) -> Robot:
    """The robot of a seed, a grammar of its law and an index; always the same one.

    size_mm: that its law leaves after a geometric fit, None for what was drawn.
    """
    number = factors if isinstance(factors, int) else zlib.crc32(factors.encode())
    rng = np.random.default_rng([zlib.crc32(b"random laws"), seed, number, index])
    arm = list(ARMS)[(5 * index + 3 * seed + number) % len(ARMS)]
    fewest, most = GRAMMARS[factors].poses
    poses = round(float(np.exp(rng.uniform(np.log(fewest), np.log(most)))))
    case = Case(f"law_{factors}_{seed}_{index}", arm, poses, round(float(rng.uniform(0.02, 0.06)), 4))
    kind = "law"
    if not factors:
        kind = list(INNOCENT)[index % len(INNOCENT)]
        case = replace(case, **INNOCENT[kind])
        case = replace(case, poses=max(case.poses // case.repeats, 30) * case.repeats)
    machine = stand(case, ARMS[arm], rng)
    names = [name for name in RANGES if rng.random() < 0.5]
    law, place, amount, size = None, None, 0.0, 0.0
    if factors:
        size = float(rng.uniform(0.15, 0.5))
        law, place, kind, amount = _findable(machine, factors, size, names, rng)
        if size_mm is not None:
            amount, size = amount * size_mm / size, size_mm
        machine = replace(machine, shapes=[_shape(law, place)])
    train = _measured(machine, amount, case.poses, names, rng)
    if case.walk_mm:
        train = replace(train, measured=train.measured + walk_noise(case, train.clean, rng))
    later = machine.under(outliers=0.0, repeats=1, labelled=False, order="independent")
    return Robot(kind, machine, law, place, amount, size, train, _measured(later, amount, FRESH, names, rng))


def _findable(
    machine: Machine, factors: int | str, size_mm: float, names: list[str], rng: np.random.Generator
) -> tuple[Law, Place, str, float]:
    """A law, its place, its shape, and the amount with which it leaves `size_mm` after the geometric fit.

    It leaves a good part of its motion, at more than a few poses, and moves nothing by more than `LARGEST`.
    """
    _, world = _world(machine, PROBE, names, rng)
    ranges = _ranges(machine, world)
    grammar = GRAMMARS[factors]
    drives = [p for p in places(machine.arm) if p.slot.endswith("moving") and p.axis == _drive(machine, p)]
    while True:
        pool = drives if rng.random() < DRIVES else places(machine.arm)
        place = pool[rng.integers(len(pool))]
        count = int(rng.choice(grammar.inputs)) if len(grammar.inputs) > 1 else grammar.inputs[0]
        inputs = _inputs(ranges, count, rng)
        kind, text = grammar.draw(rng, count)
        law = drawn_law(text, inputs, ranges)
        motion = _shape(law, place).true(world)
        largest = float(np.abs(law(columns_of(world))).max())
        matrix = jacobian(machine.arm, machine.placement, machine.tool, np.zeros(10 + 6 * len(machine.errors)),
                          world.q, [motion])  # fmt: skip
        moved = np.sum(matrix[:, -1].reshape(-1, 3) ** 2, axis=1)
        left = left_by(machine.arm, world.q, machine.placement, machine.tool, motion)
        spread = moved.mean() ** 2 > MINIMUM_SPREAD * np.mean(moved**2)
        if spread and left > MINIMUM_LEFT * np.sqrt(moved.mean()) and 1e-3 * size_mm * largest < LARGEST * left:
            return law, place, kind, 1e-3 * size_mm / left


def _inputs(ranges: dict[str, tuple[float, float]], factors: int, rng: np.random.Generator) -> tuple[str, ...]:
    """Different inputs: joint values, torques and readings, each kind about as often."""
    joints, torques = ([n for n in ranges if n.startswith(kind)] for kind in ("J", "torque"))
    groups = [joints, torques, [n for n in ranges if n in RANGES]]
    chosen: list[str] = []
    while len(chosen) < factors:
        group = groups[rng.choice(3, p=[0.4, 0.35, 0.25])]
        if group and (name := str(rng.choice(group))) not in chosen:
            chosen.append(name)
    return tuple(chosen)


def _drive(machine: Machine, place: Place) -> str:
    return "Tz" if int(place.slot[1:].split(".")[0]) in machine.arm.prismatic else "Rz"


def _ranges(machine: Machine, world: World) -> dict[str, tuple[float, float]]:
    """Return the lowest and highest sample values of joint values, varying torques and readings."""
    columns = columns_of(world)
    bounds = {name: (float(values.min()), float(values.max())) for name, values in columns.items()}
    widest = max((b - a for name, (a, b) in bounds.items() if name.startswith("torque")), default=0.0)
    least = max(TORQUES[0] * widest, TORQUES[1])
    return {n: (a, b) for n, (a, b) in bounds.items() if not n.startswith("torque") or b - a > least}


def columns_of(world: World) -> dict[str, Array]:
    """Everything a law may read: joint values, torques of gravity about turning joints, readings."""
    joints = range(1, len(world.arm.rows) + 1)
    torques = {f"torque_J{j}": world.torque(j) for j in joints if j not in world.arm.prismatic}
    return {**{f"J{j}": world.angle(j) for j in joints}, **torques, **world.extra}


def _shape(law: Law, place: Place) -> Shape:
    def motion(world: World) -> Motion:
        return place.motion(world.arm, law(columns_of(world)))

    return Shape(motion, lambda w: [motion(w)], [list(law.inputs)], {})


def _world(machine: Machine, count: int, names: list[str], rng: np.random.Generator) -> tuple[Route, World]:
    chosen = route(machine.case, region(machine.case, machine.arm, machine.centre, False), count, rng)
    count = len(chosen.q)
    extra = readings(names, count, rng)
    return chosen, world_of(machine.arm, chosen.q, extra, np.linspace(0, 1, count), machine.tool, machine.placement)


def _measured(machine: Machine, amount: float, count: int, names: list[str], rng: np.random.Generator) -> Sheet:
    chosen, world = _world(machine, count, names, rng)
    return machine.measured([amount] * len(machine.shapes), chosen, world, rng)
