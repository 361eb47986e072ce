"""Errors of the geometric fit and of the oracle on one blind robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.blind.oracle import CUT, Fit, fit, register, rms_mm
from experiments.blind.robot import Robot, Sheet
from experiments.blind.shapes import Motion
from experiments.blind.simulator import Array


@dataclass(frozen=True)
class Judgement:
    """errors: 3-D rms in mm; standard: points (N, 3), m, that the geometric fit has for every fresh sheet."""

    errors: dict[str, float]
    standard: list[Array]


@dataclass(frozen=True)
class Told:
    """Starting point of least squares on a robot's table.

    good: rows that are no outliers.
    start: placement and tool of the nominal arm.
    plain: geometric fit.
    tool, place: reference for loads and readings.
    columns: columns of the effects.
    """

    good: Array
    start: tuple[Array, Array]
    plain: Fit
    tool: Array
    place: Array
    columns: list[Motion]


def told(robot: Robot, cut: float = CUT) -> Told:
    """The form of every effect of a robot, at the poses of its table."""
    train = robot.train
    good = np.setdiff1d(np.arange(len(train.q)), train.outliers)
    start = register(robot.arm, train.q[good], train.measured[good])
    plain = fit(robot.arm, train.q[good], train.measured[good], [], start, cut)
    tool, place = plain.tool + plain.amounts[6:9], start[0]
    columns = [{k: v[good] for k, v in column.items()} for column in robot.columns(train, tool, place)]
    return Told(good, start, plain, tool, place, columns)


def judge(robot: Robot, cut: float = CUT) -> Judgement:
    """3-D rms in mm on table and fresh poses, of the geometric fit and of the oracle, against clean and measured."""
    train, known = robot.train, told(robot, cut)
    good, plain, columns = known.good, known.plain, known.columns
    oracle = fit(robot.arm, train.q[good], train.measured[good], columns, known.start, cut) if columns else plain

    def predicted(model: Fit, sheet: Sheet) -> Array:
        named = robot.columns(sheet, known.tool, known.place) if model is oracle and columns else []
        return model.predict(sheet.q, named)

    out: dict[str, float] = {}
    for name, model in (("geometric", plain), ("oracle", oracle)):
        here = model.predict(train.q[good], columns if model is oracle else [])
        out[f"{name}_train_mm"] = rms_mm(here - train.measured[good])
        for where, sheets in (("", robot.fresh), ("beyond_", robot.beyond)):
            if sheets:
                there = np.vstack([predicted(model, s) for s in sheets])
                out[f"{name}_{where}clean_mm"] = rms_mm(there - np.vstack([s.clean for s in sheets]))
                out[f"{name}_{where}noisy_mm"] = rms_mm(there - np.vstack([s.measured for s in sheets]))
    return Judgement(out, [predicted(plain, s) for s in (*robot.fresh, *robot.beyond)])
