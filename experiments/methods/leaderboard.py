"""Methods side by side on the robots that all of them have done, below two that are told what nobody knows."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from experiments.methods.rows import Row, explained, key, summary

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
