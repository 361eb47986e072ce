"""Run any method of `experiments.methods` on blind robots."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

from experiments.blind.cases import CASES
from experiments.blind.files import write
from experiments.blind.generate import make
from experiments.blind.judge import judge
from experiments.methods.plug import Method, asked, folder_name, method_named
from experiments.methods.plug import write as write_board
from experiments.methods.rows import Row, append, rounded, saved


def judged(case: str, seed: int, method: Method, folder: Path) -> Row:
    """One robot given to a method: its first sheet of fresh poses, in the table's range, against where it is."""
    robot = make(case, seed)
    robot = replace(robot, fresh=robot.fresh[:1], beyond=[])
    shutil.rmtree(folder, ignore_errors=True)
    write(robot, folder)
    errors = judge(robot).errors
    bounds = errors["geometric_clean_mm"], errors["oracle_clean_mm"]
    files = folder / "table.csv", folder / "robot.urdf", folder / "fresh_0.csv"
    scored, answer = asked(method, files, robot.fresh[0].clean, bounds)
    row = {"case": case, "seed": seed, "geometry_mm": bounds[0], "oracle_mm": bounds[1], **scored}
    if answer is None or answer.findings is None:
        return row
    return {**row, "names": [f"{f.name} @ {f.slot}" for f in answer.findings]}


def group(row: Row) -> str:
    """The board on which a robot counts."""
    return "Robots with something undeclared" if CASES[row["case"]].effects else "Robots with nothing"


def run(jobs: list[tuple[str, int]], name: str, work: Path, results: Path | None) -> None:
    """A line a robot, and the leaderboard of all methods of the file beside it; robots of the file are left out."""
    method = method_named(name)
    rows = saved(results)
    for case, seed in jobs:
        if (name, case, seed) in rows:
            continue
        row = {"method": name, **judged(case, seed, method, work / f"{folder_name(name)}_{case}_{seed}")}
        rows[name, case, seed] = row
        print(json.dumps(rounded(row)), flush=True)
        if results:
            append(row, results)
            write_board(rows.values(), group, results)
