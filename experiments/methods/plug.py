"""Define the interface of a method that predicts the tool position from a measured table.

A method is a function of three paths: table (CSV), description (URDF), and poses (CSV without positions). The method
returns positions (N, 3), m, in the instrument's frame, or an `Answer`. Others are named as package.module:function.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.blind.oracle import rms_mm
from experiments.blind.simulator import Array
from experiments.methods.rows import Row, explained, key, summary
from gpmodel.discovery import formulas
from gpmodel.errors import GpModelError
from gpmodel.evolution.formulas import formulas_at
from gpmodel.report.schema_search import EffectRecord

COLUMNS = (
    "failed", "within 1.25", "within 1.5", "median ratio", "worst ratio", "explained to 95 %", "median explained",
    "median seconds",
)  # fmt: skip
Rows = dict[tuple[Any, ...], Row]
"""Rows of one method, by robot."""


def told(rows: Rows) -> dict[str, Rows]:
    """Two methods that are told what nobody knows: the surface, inputs and place; the oracle, the law as well."""
    out = {}
    for name, error in (("*told inputs and place*", "surface_mm"), ("*told the law*", "oracle_mm")):
        if rows and all(error in row for row in rows.values()):
            out[name] = {robot: as_method(row, row[error]) for robot, row in rows.items()}
    return out


def as_method(row: Row, error_mm: float) -> Row:
    """The row of a method with that error."""
    out = {"ratio": error_mm / row["oracle_mm"], "seconds": 0.0}
    if row["geometry_mm"] != row["oracle_mm"]:
        out["explained"] = explained(row["geometry_mm"], error_mm, row["oracle_mm"])
    return out


def board(rows: Iterable[Row], title: str) -> str:
    """Markdown: a line a method, best median first, over the robots that all of them have done."""
    methods: dict[str, Rows] = {}
    for row in rows:
        methods.setdefault(row["method"], {})[key(row)[1:]] = row
    common = set.intersection(*(set(own) for own in methods.values()))
    if not common:
        return ""
    chosen = {name: {robot: own[robot] for robot in common} for name, own in methods.items()}
    richest = max(chosen.values(), key=lambda own: sum(map(len, own.values())))
    counts = {name: summary(own.values()) for name, own in {**chosen, **told(richest)}.items()}
    order = sorted(counts, key=lambda name: counts[name].get("median ratio", float("inf")))
    lines = [f"## {title}, {len(common)} robots", ""]
    lines += ["| method | " + " | ".join(COLUMNS) + " |", "|" + "---|" * (1 + len(COLUMNS))]
    lines += [f"| {name} | " + " | ".join(str(counts[name].get(c, "")) for c in COLUMNS) + " |" for name in order]
    return "\n".join([*lines, "", ""])


def all_counts(groups: dict[str, list[Row]]) -> str:
    """Markdown: a column a method and a group, a line a count."""
    own: dict[str, list[Row]] = {}
    for title, rows in groups.items():
        for row in rows:
            own.setdefault(f"{row['method']}: {title}", []).append(row)
    counts = {name: summary(rows) for name, rows in own.items()}
    names = list(dict.fromkeys(name for count in counts.values() for name in count))
    lines = [" | ".join(["", "", *counts, ""]).strip(), "|" + "---|" * (1 + len(counts))]
    lines += [f"| {name} | " + " | ".join(str(c.get(name, "")) for c in counts.values()) + " |" for name in names]
    return "\n".join(["## All counts", "", *lines, ""])


def leaderboard(rows: Iterable[Row], group: Callable[[Row], str]) -> str:
    """Markdown: a board a group of robots, then all counts."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(group(row), []).append(row)
    ordered = dict(sorted(groups.items()))
    head = "# Error over an oracle that is told what is missing\n\n"
    return head + "".join(board(own, title) for title, own in ordered.items()) + all_counts(ordered)


def write(rows: Iterable[Row], group: Callable[[Row], str], results: Path) -> None:
    """The leaderboard beside a file of results, under the same name with .md."""
    results.with_suffix(".md").write_text(leaderboard(rows, group), encoding="utf-8")


POSITION = ["x [mm]", "y [mm]", "z [mm]"]
Files = tuple[Path, Path, Path]
"""Table, description and poses."""


@dataclass(frozen=True)
class Answer:
    """positions (N, 3), m, in the instrument's frame; findings: what the method adds to the geometry, where it says."""

    positions: Array
    findings: tuple[EffectRecord, ...] | None = None


Method = Callable[[Path, Path, Path], Answer | Array]


def predicted(model: gp.Model, poses: Path) -> Array:
    """(N, 3) m of a fitted model, for poses of the same session, measured or not."""
    frame = pd.read_csv(poses).drop(columns=POSITION, errors="ignore")
    return np.asarray(1e-3 * model.predict(frame, session=True, as_measured=True)[POSITION].to_numpy())


def geometry(table: Path, urdf: Path, poses: Path) -> Array:
    """Registration, tool and the standard model alone."""
    return predicted(gp.calibrate(urdf, table, holdout=0.0).model, poses)


def discover(table: Path, urdf: Path, poses: Path, search: gp.Search | None = None) -> Answer:
    """The whole loop as it is shipped, or searched otherwise."""
    result = gp.discover(urdf, table, search=search)
    return Answer(predicted(result.model, poses), result.findings)


def without_runs(table: Path, urdf: Path, poses: Path) -> Answer:
    """The loop without programs evolved at all sites: formulas are bred where smooth terms are selected."""
    return discover(table, urdf, poses, gp.Search(runs=0, workers=1))


def founders(table: Path, urdf: Path, poses: Path) -> Answer:
    """The loop without programs and without generations: formulas are the founders, shortened."""
    with patch.object(formulas, "formulas_at", partial(formulas_at, generations=0)):
        return without_runs(table, urdf, poses)


METHODS = {
    "geometry": ("experiments.methods.plug:geometry", ()),
    "discover": ("experiments.methods.plug:discover", ()),
    "without runs": ("experiments.methods.plug:without_runs", ()),
    "founders": ("experiments.methods.plug:founders", ()),
    "pybotics": ("experiments.methods.regressions:pybotics", ("pybotics",)),
    "figaroh": ("experiments.methods.regressions:figaroh", ("figaroh",)),
    "gaussian process": ("experiments.methods.regressions:gaussian_process", ("sklearn",)),
    "symbolic regression": ("experiments.methods.regressions:symbolic_regression", ("pyoperon",)),
}
"""By name: the function, and the packages without which it cannot run."""


def method_named(name: str) -> Method:
    """One of `METHODS`, or a function written as package.module:function."""
    target, needed = METHODS.get(name, (name, ()))
    module, colon, function = target.partition(":")
    if not colon:
        raise SystemExit(f"--method: {name!r}, expected {', '.join(METHODS)}, or package.module:function")
    if missing := [package for package in needed if find_spec(package) is None]:
        raise SystemExit(f"--method {name}: needs {', '.join(missing)}, see experiments/methods/README.md")
    try:
        found: Method = getattr(import_module(module), function)
    except (ImportError, AttributeError) as failure:
        raise SystemExit(f"--method: {failure}") from failure
    return found


def folder_name(name: str) -> str:
    """A method as a part of the name of a folder."""
    return name.replace(":", ".").replace(" ", "-")


def asked(method: Method, files: Files, true: Array, bounds: tuple[float, float]) -> tuple[Row, Answer | None]:
    """Run a method on one robot: 3-D rms at the poses against the true positions (N, 3), m, and its answer.

    bounds: errors of geometry and oracle, mm.  ratio: the method's error over the oracle's; explained:
    (g^2 - m^2) / (g^2 - o^2) of geometry, method and oracle, where these differ; failed: what it said instead.
    """
    started = time.perf_counter()
    try:
        given = method(*files)
        answer = given if isinstance(given, Answer) else Answer(np.asarray(given, dtype=float))
        if answer.positions.shape != true.shape or not np.isfinite(answer.positions).all():
            raise ValueError(f"positions {answer.positions.shape}, expected {true.shape}, all finite")
    except (GpModelError, ValueError, RuntimeError, np.linalg.LinAlgError) as failure:
        return {"failed": f"{type(failure).__name__}: {failure}"}, None
    seconds = round(time.perf_counter() - started, 1)
    error, (geometric, oracle) = rms_mm(answer.positions - true), bounds
    row: Row = {"seconds": seconds, "error_mm": error, "ratio": error / oracle}
    return row | ({"explained": explained(geometric, error, oracle)} if geometric != oracle else {}), answer
