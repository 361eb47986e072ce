"""Compute the errors of the geometric fit and of the oracle on one blind robot."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.blind.cases import CASES, FAMILIES
from experiments.blind.grading import summarise
from experiments.blind.oracle import CUT, Fit, fit, register, rms_mm
from experiments.blind.robot import Robot, Sheet
from experiments.blind.shapes import Motion
from experiments.blind.simulator import Array

COUNTS = (
    "robots", "failed", "within_goal", "median_ratio", "worst_ratio", "within_goal_exact", "median_ratio_exact",
    "worst_ratio_exact", "worse_than_standard", "effects_named", "effects", "false_additions", "readable", "findings",
    "within_2_sigma", "parameters", "slowest_s",
)  # fmt: skip
COLUMNS = (
    "case", "set", "seed", "geometry", "oracle", "product", "ratio", "exact", "to geometry", "named", "false",
    "readable",
)  # fmt: skip


def saved(file: Path | None) -> dict[tuple[str, int], dict[str, Any]]:
    """Rows of an earlier run, by case and seed."""
    if file is None or not file.exists():
        return {}
    return {(row["case"], row["seed"]): row for row in json.loads(file.read_text())["robots"]}


def save(found: dict[tuple[str, int], dict[str, Any]], command: str, file: Path) -> None:
    """Results and tables as they stand; a kill leaves the last ones whole."""
    order = list(CASES)
    rows = [found[key] for key in sorted(found, key=lambda key: (order.index(key[0]), key[1]))]
    text = json.dumps({"summary": {"command": command, **summarise(rows)}, "robots": rows}, indent=1) + "\n"
    for path, content in ((file, text), (file.with_suffix(".md"), markdown(rows, command))):
        part = path.with_name(path.name + ".part")
        part.write_text(content)
        part.replace(path)


def markdown(rows: list[dict[str, Any]], command: str) -> str:
    """Counts over each family, then each robot; 3-D rms on fresh measured poses in mm, outside the range after '/'."""
    groups = {family: [r for r in rows if CASES[r["case"]].family == family] for family in FAMILIES}
    groups = {family: own for family, own in groups.items() if own}
    lines = [f"`{command}`", "", line(("family", *(c.replace("_", " ") for c in COUNTS))), rule(1 + len(COUNTS))]
    for family, own in {**groups, "all": rows}.items():
        counts = summarise(own)
        lines.append(line((family, *(number(counts[c]) for c in COUNTS))))
    for family, own in groups.items():
        lines += ["", f"## {family}", "", line((*COLUMNS, "added", "s")), rule(len(COLUMNS) + 2), *map(_robot, own)]
    return "\n".join([*lines, ""])


def _robot(row: dict[str, Any]) -> str:
    cells = [row["case"], "aside" if CASES[row["case"]].aside else "open", row["seed"]]
    cells += [_both(row, f"{who}_{{}}noisy_mm") for who in ("geometric", "oracle", "product")]
    cells += [_both(row, f"ratio_{{}}{kind}") for kind in ("noisy", "clean")]
    cells += [_both(row, "ratio_{}standard") + (" worse" if row.get("worse") else "")]
    if "failed" in row:
        return line((*cells, "", "", "", f"failed: {row['failed']}", ""))
    if "named" not in row:
        return line((*cells, "", "", "", "", ""))
    counts = (f"{row['effects_named']} of {row['effects']}", row["false"], f"{row['readable']} of {len(row['found'])}")
    return line((*cells, *counts, "; ".join(row["found"]) or "nothing", row["seconds"]))


def _both(row: dict[str, Any], key: str) -> str:
    return " / ".join(number(row[k]) for k in (key.format(""), key.format("beyond_")) if k in row)


def number(value: Any) -> str:
    """A cell: three places where there are any, nothing for None."""
    return f"{value:.3f}" if isinstance(value, float) else "" if value is None else str(value)


def line(cells: Iterable[Any]) -> str:
    """A row of a table."""
    return "| " + " | ".join(str(cell).replace("|", "/") for cell in cells) + " |"


def rule(columns: int) -> str:
    """The row below the names of the columns."""
    return "|" + "---|" * columns


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
