"""From a case and a seed to the files of one blind robot: mechanism, measured table, fresh poses, the truth."""

from __future__ import annotations

import json
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.blind.arms import ARMS
from experiments.blind.cases import Case
from experiments.blind.effects import Motion, Shape, World, combine, draw
from experiments.blind.oracle import fit, left_by, register, rms_mm
from experiments.blind.simulator import Arm, Array, draw_poses, gravity_loads, points, small_motion, urdf

FRESH = 500
UNITS = {"temperature": "degC", "payload": "kg", "time": "min", "humidity": "1", "operator": "1"}


@dataclass(frozen=True)
class Sheet:
    """Poses as a user would have them, and where they are: clean and measured (N, 3), metres, in the tracker."""

    q: Array
    extra: dict[str, Array]
    row: Array
    clean: Array
    measured: Array
    outliers: Array


@dataclass(frozen=True)
class Robot:
    """One blind robot; `world` knows only what the description of the arm says."""

    case: Case
    seed: int
    arm: Arm
    shapes: list[Shape]
    amounts: list[float]
    placement: Array
    tool: Array
    train: Sheet
    fresh: list[Sheet]

    def columns(self, sheet: Sheet, tool: Array) -> list[Motion]:
        world = world_of(self.arm, sheet.q, sheet.extra, sheet.row, tool)
        return [column for shape in self.shapes for column in shape.basis(world)]


def world_of(arm: Arm, q: Array, extra: dict[str, Array], row: Array, tool: Array) -> World:
    """What an arm of these masses is known by; the payload hangs at the tool point."""
    return World(arm, q, extra, row, gravity_loads(arm, q, extra.get("payload"), tool), tool)


def _extra(name: str, row: Array, count: int, rng: np.random.Generator) -> Array:
    """A column of a table of `count` rows."""
    if name == "temperature":
        return np.round(24.0 + 5.0 * np.sin(2 * np.pi * (1.3 * row + rng.uniform())) + rng.normal(0, 0.7, count), 2)
    if name == "payload":
        return np.asarray(rng.choice([0.0, 2.0, 5.0, 10.0], count))
    if name == "time":
        return np.round(120.0 * row + rng.uniform(-0.4, 0.4, count), 2)
    if name == "humidity":
        return np.round(0.45 + 0.1 * row + rng.normal(0, 0.03, count), 3)
    if name == "operator":
        return np.asarray(rng.integers(1, 4, count), dtype=float)
    return np.asarray(rng.choice([-1.0, 1.0], count))


def make(case: Case, seed: int) -> Robot:
    """Draw a robot.  The same case and seed always give the same robot; aside cases never share a stream."""
    rng = np.random.default_rng([zlib.crc32(case.name.encode()), seed, 7919 if case.aside else 17])
    arm = ARMS[case.arm]
    joints = len(arm.rows)
    heavy = arm.heavier(1.0 + rng.uniform(-1, 1, joints) * case.masses_off)
    size = rng.uniform([[0.1e-3] * 3 + [0.2e-3] * 3] * joints, [[1e-3] * 6] * joints)
    errors = size * rng.choice([-1.0, 1.0], size.shape)
    tool = rng.normal(size=3)
    tool *= rng.uniform(0.05, 0.3) / np.linalg.norm(tool)
    placement = small_motion(np.concatenate([rng.uniform(-3, 3, 3), rng.normal(size=3) * 1.5])[None])[0]
    shapes = [draw(kind, arm, rng, **settings) for kind, settings, _ in case.effects]

    def sheet(count: int, amounts: list[float], outliers: float) -> Sheet:
        q: Array = np.radians(np.round(np.degrees(draw_poses(arm, count, rng)), 4).astype(float))
        row = np.arange(count) / max(case.poses - 1, 1)
        extra = {name: _extra(name, row, count, rng) for name in case.columns}
        world = world_of(heavy, q, extra, row, tool)
        constants: list[Motion] = [{i + 1: np.tile(errors[i], (count, 1))} for i in range(joints)]
        motions = constants + [shape.true(world) for shape in shapes]
        clean = points(arm, q, placement, tool, combine(np.array([1.0] * joints + amounts), motions))
        spread = np.full(count, case.noise_mm)
        if case.noise == "distance":
            distance = np.linalg.norm(clean, axis=1)
            spread = spread * distance / distance.mean()
        measured = clean + 1e-3 * spread[:, None] * rng.normal(size=(count, 3))
        wrong = rng.permutation(count)[: round(outliers * count)]
        jump = rng.normal(size=(len(wrong), 3))
        jump *= 1e-3 * rng.uniform(0.6, 3.0, (len(wrong), 1)) / np.linalg.norm(jump, axis=1, keepdims=True)
        measured[wrong] += jump
        return Sheet(q, extra, row, clean, measured, np.sort(wrong))

    probe = sheet(max(case.poses, 150), [0.0] * len(shapes), 0.0)
    probe_world = world_of(heavy, probe.q, probe.extra, np.linspace(0, 1, len(probe.q)), tool)
    amounts = [
        1e-3 * target / left_by(arm, probe.q, placement, tool, shape.true(probe_world))
        for shape, (_, _, target) in zip(shapes, case.effects, strict=True)
    ]
    train = sheet(case.poses, amounts, case.outliers)
    by_row = any(["row"] in shape.named for shape in shapes)
    counts = [case.poses] * round(FRESH / case.poses) if by_row else [FRESH]
    fresh = [sheet(count, amounts, 0.0) for count in counts]
    return Robot(case, seed, arm, shapes, amounts, placement, tool, train, fresh)


def judge(robot: Robot, cut: float | None = None) -> dict[str, float]:
    """3-D rms in mm on the fresh poses, of the geometric fit and of the oracle, against clean and measured points."""
    train = robot.train
    good = np.setdiff1d(np.arange(len(train.q)), train.outliers)
    start = register(robot.arm, train.q[good], train.measured[good])
    options = {} if cut is None else {"cut": cut}
    plain = fit(robot.arm, train.q[good], train.measured[good], [], start, **options)
    tool = plain.tool + plain.amounts[6:9]
    told = [{k: v[good] for k, v in column.items()} for column in robot.columns(train, tool)]
    oracle = fit(robot.arm, train.q[good], train.measured[good], told, start, **options)
    out: dict[str, float] = {}
    for name, model, columns in (("geometric", plain, False), ("oracle", oracle, True)):
        there = [model.predict(s.q, robot.columns(s, tool) if columns else []) for s in robot.fresh]
        here = model.predict(train.q[good], told if columns else [])
        predicted = np.vstack(there)
        out[f"{name}_train_mm"] = rms_mm(here - train.measured[good])
        out[f"{name}_clean_mm"] = rms_mm(predicted - np.vstack([s.clean for s in robot.fresh]))
        out[f"{name}_noisy_mm"] = rms_mm(predicted - np.vstack([s.measured for s in robot.fresh]))
    return out


def _table(robot: Robot, sheet: Sheet, positions: Array | None) -> str:
    names = [f"{j} [deg]" for j in robot.arm.joints]
    names += [f"{name} [{UNITS.get(name, '1')}]" for name in sheet.extra]
    blocks = [np.degrees(sheet.q), *[v[:, None] for v in sheet.extra.values()]]
    forms = ["%.4f"] * len(robot.arm.joints) + ["%g"] * len(sheet.extra)
    if positions is not None:
        names += ["x [mm]", "y [mm]", "z [mm]"]
        blocks.append(1e3 * positions)
        forms += ["%.5f"] * 3
    rows = (",".join(form % v for form, v in zip(forms, row, strict=True)) for row in np.hstack(blocks))
    return "\n".join([",".join(names), *rows, ""])


def write(robot: Robot, folder: Path) -> dict[str, Any]:
    """robot.urdf, table.csv, truth.json; fresh_K.csv without and fresh_K_clean.csv, _noisy.csv with positions."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(urdf(robot.arm))
    (folder / "table.csv").write_text(_table(robot, robot.train, robot.train.measured))
    for k, sheet in enumerate(robot.fresh):
        (folder / f"fresh_{k}.csv").write_text(_table(robot, sheet, None))
        (folder / f"fresh_{k}_clean.csv").write_text(_table(robot, sheet, sheet.clean))
        (folder / f"fresh_{k}_noisy.csv").write_text(_table(robot, sheet, sheet.measured))
    truth: dict[str, Any] = {
        "case": {k: v for k, v in asdict(robot.case).items() if k != "effects"},
        "seed": robot.seed,
        "effects": [
            {
                "kind": kind, "settings": settings, "size_mm": target, "amount": amount,
                "constants": shape.constants, "named": shape.named,
            }
            for (kind, settings, target), shape, amount in zip(
                robot.case.effects, robot.shapes, robot.amounts, strict=True
            )
        ],
        "outliers": robot.train.outliers.tolist(),
        "fresh": [f"fresh_{k}" for k in range(len(robot.fresh))],
        "poses_fresh": sum(len(s.q) for s in robot.fresh),
        "errors": judge(robot),
    }  # fmt: skip
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))
    return truth
