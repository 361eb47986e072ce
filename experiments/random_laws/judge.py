"""One robot from its numbers to a row of results: a method against exact positions, geometry and a told oracle."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import numpy as np

import gpmodel as gp
from experiments.blind.description import urdf
from experiments.blind.files import table
from experiments.blind.oracle import rms_mm
from experiments.blind.simulator import Array
from experiments.random_laws.findings import graded
from experiments.random_laws.methods import Answer, Method, geometry, predicted
from experiments.random_laws.results import Row, explained
from experiments.random_laws.robot import Robot, make
from experiments.random_laws.surface import surface
from gpmodel.errors import GpModelError
from gpmodel.model.error_model import prepare
from gpmodel.model.states import States
from gpmodel.table.read import read_table


def write(robot: Robot, folder: Path) -> tuple[Path, Path, Path]:
    """table.csv, robot.urdf and poses.csv, which has no positions."""
    folder.mkdir(parents=True, exist_ok=True)
    machine = robot.machine
    files = folder / "table.csv", folder / "robot.urdf", folder / "poses.csv"
    files[0].write_text(table(machine.arm, robot.train, robot.train.measured, machine.case.labelled))
    files[1].write_text(urdf(machine.arm))
    files[2].write_text(table(machine.arm, robot.fresh, None))
    return files


def oracle(robot: Robot, files: tuple[Path, Path, Path]) -> tuple[Answer, States]:
    """Told the law and its place, its amount solved with the geometry; and the columns of the fresh poses."""
    law, place = robot.law, robot.place
    told = [gp.effect_at("told", place.slot, place.axis, law, family="told")] if law and place else []
    model = gp.calibrate(files[1], files[0], told, holdout=0.0).model
    poses = read_table(files[2], model.mechanism, need_measurement=False)
    return Answer(predicted(model, files[2])), prepare(model.mechanism, poses).states


def drawn(robot: Robot) -> Row:
    """What the robot is."""
    case, law, place = robot.machine.case, robot.law, robot.place
    return {
        "arm": case.arm, "poses": len(robot.train.q), "noise_mm": case.noise_mm, "kind": robot.kind,
        "size_mm": robot.size_mm, "law": str(law or ""), "inputs": list(law.inputs if law else ()),
        "place": f"{place.slot} {place.axis}" if place else "",
    }  # fmt: skip


def judge(seed: int, factors: int, index: int, method: Method, folder: Path) -> Row:
    """Errors are 3-D rms in mm at the fresh poses against exact positions.

    ratio: the method's over the oracle's; explained: (g^2 - m^2) / (g^2 - o^2) of geometry, method and oracle;
    of_surface: the same with a Gaussian process that is told inputs and place in the oracle's stead.
    """
    robot = make(seed, factors, index)
    shutil.rmtree(folder, ignore_errors=True)
    files = write(robot, folder)
    row: Row = {"seed": seed, "factors": factors, "index": index, **drawn(robot)}

    def error(positions: Array) -> float:
        return rms_mm(positions - robot.fresh.clean)

    try:
        told, states = oracle(robot, files)
        row |= {"geometry_mm": error(geometry(*files).positions), "oracle_mm": error(told.positions)}
        started = time.perf_counter()
        answer = method(*files)
    except (GpModelError, ValueError, np.linalg.LinAlgError) as failure:
        return {**row, "failed": f"{type(failure).__name__}: {failure}"}
    row |= {"seconds": round(time.perf_counter() - started, 1), "error_mm": error(answer.positions)}
    row["ratio"] = row["error_mm"] / row["oracle_mm"]
    if robot.law:
        row["surface_mm"] = error(surface(robot))
        for share, best in (("explained", "oracle_mm"), ("of_surface", "surface_mm")):
            row[share] = explained(row["geometry_mm"], row["error_mm"], row[best])
    return row if answer.findings is None else {**row, **graded(answer.findings, robot, states)}
