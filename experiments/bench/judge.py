"""Compute the error of `discover` on one robot of the bench, over the error of an oracle."""

from __future__ import annotations

import os
import shutil
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import gpmodel as gp
from experiments.bench.robots import Robot
from experiments.blind import judge as blind
from experiments.blind.case import Case
from experiments.blind.files import truth_of, write
from experiments.blind.generate import make
from experiments.blind.grading import grade
from experiments.methods.plug import POSITION, Answer, Method, asked
from experiments.methods.rows import Row, rounded
from experiments.random_laws import judge as laws
from gpmodel.discovery.search import Search


def judge(robot: Robot, folder: Path) -> Row:
    """ratio: against exact positions; named of effects; false additions; found: names; seconds: of processor time."""
    began = _seconds()
    judged = _formula(robot, folder) if robot.case is None else _blind(robot, robot.case, folder)
    shutil.rmtree(folder, ignore_errors=True)
    return rounded({"robot": robot.name, "kind": robot.kind, **judged, "seconds": round(_seconds() - began, 1)})


def _seconds() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def method(robot: Robot, in_order: bool, session: bool) -> Method:
    """Discover as shipped, or without genetic programming. in_order: the rows of the table are in order of measurement;
    session: so are those of the poses."""
    search = replace(Search(workers=1), **({} if robot.evolved else {"runs": 0}))

    def discover(table: Path, urdf: Path, poses: Path) -> Answer:
        found = gp.discover(urdf, gp.read_table(table, urdf, in_order=in_order), search=search)
        frame = found.model.predict(poses, session=session, in_order=in_order and session, as_measured=True)
        return Answer(1e-3 * frame[POSITION].to_numpy(), found.findings)

    return discover


def _blind(robot: Robot, case: Case, folder: Path) -> Row:
    made = make(case, robot.seed)
    made = replace(made, fresh=made.fresh[:1], beyond=[])
    write(made, folder)
    errors = blind.judge(made).errors
    bounds = errors["geometric_clean_mm"], errors["oracle_clean_mm"]
    files = folder / "table.csv", folder / "robot.urdf", folder / "fresh_0.csv"
    scored, answer = asked(method(robot, case.in_order, made.by_row), files, made.fresh[0].clean, bounds)
    if answer is None:
        return scored
    graded = grade([asdict(f) for f in answer.findings or ()], truth_of(made))
    told = {"named": graded["effects_named"], "effects": graded["effects"], "false": graded["false"]}
    return {"ratio": scored["ratio"], "error_mm": scored["error_mm"], **told, "found": sorted(graded["found"])}


def _formula(robot: Robot, folder: Path) -> Row:
    row = laws.judge(robot.seed, robot.factors, robot.index, method(robot, False, True), folder)
    if "failed" in row:
        return {"failed": row["failed"]}
    named = int(row["inputs_right"] and row["place_right"])
    found: list[dict[str, Any]] = row["found"]
    told = {"named": named, "effects": 1, "false": row["false"]}
    return {
        "ratio": row["ratio"], "error_mm": row["error_mm"], **told,
        "found": sorted(f"{f['name']} @ {f['place']}" for f in found),
    }  # fmt: skip
