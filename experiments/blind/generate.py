"""Generate a blind robot from a specification and a seed."""

from __future__ import annotations

import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from experiments.blind.arms import ARMS
from experiments.blind.cases import CASES, Case
from experiments.blind.files import write
from experiments.blind.machine import Machine, stand
from experiments.blind.oracle import left_by
from experiments.blind.robot import Robot, Sheet
from experiments.blind.session import walk_noise

FRESH = 500
PROBE = 150


def make(case: Case | str, seed: int = 0, folder: Path | str | None = None) -> Robot:
    """Draw a robot, and write its files where a folder is given; a case may be said by its name.

    The same case and seed always give the same robot; aside cases never share a stream.
    """
    machine, amounts, rng = standing(case, seed)
    case = machine.case
    train = first_table(machine, amounts, rng)
    by_row = case.in_order or any(["row"] in shape.named for shape in machine.shapes)
    later = machine.under(outliers=0.0, repeats=1, order="walk" if case.order == "walk" else "independent")
    counts = [case.poses] * max(1, round(FRESH / case.poses)) if by_row else [FRESH]
    fresh = [later.measured(amounts, *later.drawn(count, rng), rng) for count in counts]
    beyond = [later.measured(amounts, *later.drawn(FRESH, rng, beyond=True), rng)] if case.trained else []
    arm = ARMS[case.arm] if case.masses != "none" else ARMS[case.arm].heavier(np.zeros(len(machine.errors)))
    place, tool = machine.placement, machine.tool
    robot = Robot(case, seed, arm, machine.shapes, amounts, place, tool, train, fresh, beyond, by_row)
    if folder is not None:
        write(robot, Path(folder))
    return robot


def standing(case: Case | str, seed: int) -> tuple[Machine, list[float], np.random.Generator]:
    """The machine of a case and a seed, the amounts of its effects, and the stream of random numbers after them."""
    case = CASES[case] if isinstance(case, str) else case
    rng = np.random.default_rng([zlib.crc32(case.name.encode()), seed, 7919 if case.aside else 17])
    machine = stand(case, ARMS[case.arm], rng)
    return machine, _amounts(machine, rng), rng


def _amounts(machine: Machine, rng: np.random.Generator) -> list[float]:
    """Return the amount of each effect that leaves the stated size after a geometric fit, on other poses of the same
    kind.
    """
    plain = machine.under(outliers=0.0, repeats=1)
    chosen, world = plain.drawn(max(machine.case.poses, PROBE), rng)
    plain.measured([0.0] * len(machine.shapes), chosen, world, rng)
    world = replace(world, row=np.linspace(0, 1, len(world.q)))
    out = []
    for shape, (_, settings, target) in zip(machine.shapes, machine.case.effects, strict=True):
        left = left_by(machine.arm, world.q, machine.placement, machine.tool, shape.true(world))
        out.append(settings["amount"] if "amount" in settings else 1e-3 * target / left)
    return out


def first_table(machine: Machine, amounts: list[float], rng: np.random.Generator) -> Sheet:
    """The measured table, the instrument's walk included."""
    sheet = machine.measured(amounts, *machine.drawn(machine.case.poses, rng), rng)
    if not machine.case.walk_mm:
        return sheet
    return replace(sheet, measured=sheet.measured + walk_noise(machine.case, sheet.clean, rng))
