"""One robot from its numbers to a row of results: a method against exact positions, geometry and a told oracle."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

import gpmodel as gp
from experiments.blind.description import urdf
from experiments.blind.files import table
from experiments.blind.grading import nodes
from experiments.blind.oracle import rms_mm
from experiments.blind.simulator import Array
from experiments.methods.plug import Files, Method, asked, geometry, predicted
from experiments.methods.rows import Row, explained
from experiments.random_laws.findings import graded
from experiments.random_laws.robot import Robot, make
from experiments.random_laws.surface import surface
from gpmodel.api.table import dataset_of
from gpmodel.errors import GpModelError
from gpmodel.model.error_model import prepare
from gpmodel.model.states import States


def write(robot: Robot, folder: Path) -> Files:
    """table.csv, robot.urdf and poses.csv, which has no positions."""
    folder.mkdir(parents=True, exist_ok=True)
    machine = robot.machine
    files = folder / "table.csv", folder / "robot.urdf", folder / "poses.csv"
    files[0].write_text(table(machine.arm, robot.train, robot.train.measured, machine.case.labelled))
    files[1].write_text(urdf(machine.arm))
    files[2].write_text(table(machine.arm, robot.fresh, None))
    return files


def oracle(robot: Robot, files: Files) -> tuple[Array, States]:
    """Told the law and its place, its amount solved with the geometry; and the columns of the fresh poses."""
    law, place = robot.law, robot.place
    told = [gp.effect_at("told", place.slot, place.axis, law, family="told")] if law and place else []
    model = gp.calibrate(files[1], files[0], told, holdout=0.0).model
    poses = dataset_of(files[2], model.mechanism, need_measurement=False)
    return predicted(model, files[2]), prepare(model.mechanism, poses).states


def drawn(robot: Robot) -> Row:
    """Describe the robot."""
    case, law, place = robot.machine.case, robot.law, robot.place
    return {
        "arm": case.arm, "poses": len(robot.train.q), "noise_mm": case.noise_mm, "kind": robot.kind,
        "size_mm": robot.size_mm, "law": str(law or ""), "law_nodes": nodes(law.text) if law else 0,
        "inputs": list(law.inputs if law else ()),
        "place": f"{place.slot} {place.axis}" if place else "",
    }  # fmt: skip


def judge(seed: int, factors: int | str, index: int, method: Method, folder: Path) -> Row:
    """Errors are 3-D rms in mm at the fresh poses against exact positions.

    of_surface: the share explained with a Gaussian process that is told inputs and place in the oracle's stead.
    """
    robot = make(seed, factors, index)
    shutil.rmtree(folder, ignore_errors=True)
    files = write(robot, folder)
    row: Row = {"seed": seed, "factors": factors, "index": index, **drawn(robot)}
    true = robot.fresh.clean
    try:
        told, states = oracle(robot, files)
        bounds = rms_mm(geometry(*files) - true), rms_mm(told - true)
    except (GpModelError, np.linalg.LinAlgError) as failure:
        return {**row, "failed": f"{type(failure).__name__}: {failure}"}
    scored, answer = asked(method, files, true, bounds)
    row |= {"geometry_mm": bounds[0], "oracle_mm": bounds[1], **scored}
    if answer is not None and robot.law:
        row["surface_mm"] = rms_mm(surface(robot) - true)
        row["of_surface"] = explained(bounds[0], row["error_mm"], row["surface_mm"])
    if answer is None or answer.findings is None:
        return row
    return {**row, **graded(answer.findings, robot, states)}
