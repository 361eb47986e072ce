"""Methods side by side on the robots that all of them have done.

From the root of the repository: python -m experiments.random_laws.leaderboard FILE.jsonl ... --out LEADERBOARD.md
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from experiments.random_laws.results import IDENTITY, Row, explained, saved, summary

COLUMNS = (
    "failed", "within 1.25", "within 1.5", "median ratio", "worst ratio", "explained to 95 %", "median explained",
    "median seconds",
)  # fmt: skip
Rows = dict[tuple[Any, ...], Row]
"""By seed, number of factors and index."""


def read(files: list[Path]) -> dict[str, Rows]:
    """Of each method its rows by robot; of a robot done twice the later one."""
    out: dict[str, Rows] = {}
    for file in files:
        for row in saved(file).values():
            out.setdefault(row["method"], {})[tuple(row[name] for name in IDENTITY[1:])] = row
    return out


def told(rows: Rows) -> dict[str, Rows]:
    """Two methods that are told what nobody knows: the surface, inputs and place; the oracle, the law as well."""
    out = {}
    for name, key in (("*told inputs and place*", "surface_mm"), ("*told the law*", "oracle_mm")):
        if all(key in row for row in rows.values()):
            out[name] = {robot: as_method(row, row[key]) for robot, row in rows.items()}
    return out


def as_method(row: Row, error_mm: float) -> Row:
    """The row of a method with that error."""
    share = explained(row["geometry_mm"], error_mm, row["oracle_mm"])
    return {"ratio": error_mm / row["oracle_mm"], "explained": share, "seconds": 0.0}


def board(methods: dict[str, Rows], factors: int) -> str:
    """Markdown: a line a method, best median first, over the robots of so many factors that all have done."""
    common = set.intersection(*({robot for robot in rows if robot[1] == factors} for rows in methods.values()))
    if not common:
        return ""
    chosen = {name: {robot: rows[robot] for robot in common} for name, rows in methods.items()}
    richest = max(chosen.values(), key=lambda rows: sum("surface_mm" in row for row in rows.values()))
    counts = {name: summary(rows.values()) for name, rows in {**chosen, **told(richest)}.items()}
    order = sorted(counts, key=lambda name: counts[name].get("median ratio", float("inf")))
    lines = [f"## Laws of {factors} {'input' if factors == 1 else 'inputs'}, {len(common)} robots", ""]
    lines += ["| method | " + " | ".join(COLUMNS) + " |", "|" + "---|" * (1 + len(COLUMNS))]
    lines += [f"| {name} | " + " | ".join(str(counts[name].get(c, "")) for c in COLUMNS) + " |" for name in order]
    return "\n".join([*lines, "", ""])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+", help="results of experiments.random_laws.run")
    parser.add_argument("--out", type=Path, help="Markdown")
    settings = parser.parse_args()
    methods = read(settings.files)
    text = "# Random laws: error over an oracle that is told the law\n\n" + "".join(board(methods, f) for f in (1, 2))
    print(text)
    if settings.out:
        settings.out.write_text(text.rstrip() + "\n")


if __name__ == "__main__":
    main()
