"""Save rows of results, one per line, and count them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from statistics import median
from typing import Any

Row = dict[str, Any]
GOAL, LOOSE, EXPLAINED = 1.25, 1.5, 0.95
SHORT_INPUTS, SHORT_NODES = 2, 9
IDENTITY = ("method", "case", "seed", "factors", "index")
"""Columns that identify robot and method, if present."""


def saved(file: Path | None) -> dict[tuple[Any, ...], Row]:
    """Rows of an earlier run; a last line that was cut short is left out."""
    if file is None or not file.exists():
        return {}
    lines = [line for line in file.read_text().splitlines(keepends=True) if line.endswith("\n")]
    return {key(row): row for row in map(json.loads, lines)}


def key(row: Row) -> tuple[Any, ...]:
    """Return the identity of method and robot."""
    return tuple(row[name] for name in IDENTITY if name in row)


def append(row: Row, file: Path) -> None:
    """One more line; one that was cut short before it goes."""
    old = file.read_text() if file.exists() else ""
    file.write_text(old[: old.rfind("\n") + 1] + json.dumps(rounded(row)) + "\n")


def rounded(row: Row) -> Row:
    """Four significant places of what was measured."""
    return {k: float(f"{v:.4g}") if isinstance(v, float) else v for k, v in row.items()}


def explained(geometry_mm: float, error_mm: float, best_mm: float) -> float:
    """Share of the squared error that could go and does."""
    return (geometry_mm**2 - error_mm**2) / (geometry_mm**2 - best_mm**2)


def summary(rows: Iterable[Row]) -> Row:
    """Counts over the robots of one method and one number of factors; innocents have what was added falsely."""
    everything = list(rows)
    done = [row for row in everything if "failed" not in row]
    ratios = [row["ratio"] for row in done]
    out: Row = {"robots": len(everything), "failed": len(everything) - len(done)}
    if not done:
        return out
    out |= {
        "within 1.25": sum(r <= GOAL for r in ratios),
        "within 1.5": sum(r <= LOOSE for r in ratios),
        "median ratio": median(ratios),
        "worst ratio": max(ratios),
        "median seconds": median(row["seconds"] for row in done),
    }
    if all("explained" in row for row in done):
        out["explained to 95 %"] = sum(row["explained"] >= EXPLAINED for row in done)
        out["median explained"] = median(row["explained"] for row in done)
    if all("of_surface" in row for row in done):
        out["median of a told surface"] = median(row["of_surface"] for row in done)
        out["median ratio of a told surface"] = median(row["surface_mm"] / row["oracle_mm"] for row in done)
    if all("found" in row for row in done):
        found = [f for row in done for f in row["found"]]
        unnamed = [f for f in found if not f["named"]]
        out |= {
            "robots with nothing": sum(not row["found"] for row in done),
            "robots with false": sum(row["false"] > 0 for row in done),
            "findings": len(found),
            "without a name": len(unnamed),
            "of these short": sum(f["inputs"] <= SHORT_INPUTS and f["nodes"] <= SHORT_NODES for f in unnamed),
        }
        if short := [row for row in done if 0 < row.get("law_nodes", 0) <= SHORT_NODES]:
            nodes = [sum(f["nodes"] for f in row["found"] if not f["named"]) for row in short]
            out |= {"short as drawn": len(short), "of these short as found": sum(n <= SHORT_NODES for n in nodes)}
    if all("inputs_right" in row for row in done):
        out |= {name.replace("_", " "): sum(row[name] for row in done) for name in ("inputs_right", "place_right")}
        out["with needless inputs"] = sum(row["inputs_needless"] > 0 for row in done)
    return rounded(out)
