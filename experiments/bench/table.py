"""Rows of two versions compared, and counts over the rows of one."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from statistics import median

from experiments.methods.rows import GOAL, Row

CHANGE = 0.02
"""Relative change of a ratio that counts: 0 is the same to the last digit, a seed of the noise gives 0.2 of it."""
COLUMNS = (
    "date", "version", "robots", "failed", "median ratio", "worst", "within 1.25", "named", "false", "processor s",
    "note",
)  # fmt: skip


def changed(before: Row | None, row: Row) -> str:
    """One line where the ratio changed by more than `CHANGE` or the names did, else nothing."""
    if before is None:
        return f"{row['robot']}: {said(row)}"
    if not (_moved(before, row) or before.get("found") != row.get("found")):
        return ""
    mark = "WORSE" if worse(before, row) else "better" if worse(row, before) else "other"
    return f"{row['robot']}: {mark}\n    before {said(before)}\n    now    {said(row)}"


def _moved(before: Row, row: Row) -> bool:
    first, second = before.get("ratio"), row.get("ratio")
    if first is None or second is None:
        return first is not second
    return bool(abs(second - first) > CHANGE * first)


def worse(before: Row, row: Row) -> bool:
    """Return whether a robot fails now, has a larger ratio, fewer names or more false additions."""
    if "failed" in row or "failed" in before:
        return "failed" in row and "failed" not in before
    larger = row["ratio"] > (1.0 + CHANGE) * before["ratio"]
    return bool(larger or row["named"] < before["named"] or row["false"] > before["false"])


def said(row: Row) -> str:
    """A row in short."""
    if "failed" in row:
        return f"failed: {row['failed']}"
    false = f", {row['false']} false" if row["false"] else ""
    found = "; ".join(row["found"]) or "nothing"
    return f"{row['ratio']:.3f}, {row['named']} of {row['effects']} named{false}, {row['seconds']:.0f} s: {found}"


def counts(rows: Iterable[Row]) -> list[str]:
    """Cells of `COLUMNS` between version and note."""
    every = list(rows)
    done = [row for row in every if "failed" not in row]
    ratios = [row["ratio"] for row in done] or [float("nan")]
    return [
        str(len(every)), str(len(every) - len(done)), f"{median(ratios):.3f}", f"{max(ratios):.2f}",
        str(sum(ratio <= GOAL for ratio in ratios)),
        f"{sum(row['named'] for row in done)} of {sum(row['effects'] for row in done)}",
        str(sum(row["false"] for row in done)), f"{sum(row['seconds'] for row in every):.0f}",
    ]  # fmt: skip


def counted(rows: Iterable[Row]) -> str:
    """Counts with their names."""
    return ", ".join(f"{name} {cell}" for name, cell in zip(COLUMNS[2:-1], counts(rows), strict=True))


def line(version: str, rows: Iterable[Row], note: str) -> str:
    """A row of the history."""
    return f"| {' | '.join((f'{datetime.now(UTC):%Y-%m-%d}', version, *counts(rows), note))} |\n"
