"""Compare a changed search on seventy robots: error over the oracle, names, false findings, seconds.

From the root of the repository: python -m experiments.bench.run --jobs 2
Prints the robots that differ from the robots of `--against`, and one line of counts; ends with 1 if a robot became
worse. --record saves the robots in results.json and adds a line to history.md.
The code of another version is measured by PYTHONSAFEPATH=1 PYTHONPATH=<its folder>:. in front of the command.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from statistics import median

import gpmodel as gp
from experiments.bench.judge import judge
from experiments.bench.robots import ROBOTS, Robot
from experiments.methods.rows import GOAL, Row
from experiments.options import parsed
from gpmodel.executor import Forks

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


HERE = Path(__file__).parent
RESULTS, HISTORY = HERE / "results.json", HERE / "history.md"


def chosen(settings: argparse.Namespace) -> list[Robot]:
    """Robots that the options select. Raises SystemExit for an unknown name."""
    every = [name for name, robot in ROBOTS.items() if robot.quick or not settings.quick]
    names = settings.only.split(",") if settings.only else every
    if unknown := [name for name in names if name not in ROBOTS]:
        raise SystemExit(f"--only: unknown robot {', '.join(unknown)}, expected names of --list")
    return [ROBOTS[name] for name in names]


def read(file: Path | None) -> dict[str, Row]:
    """Rows by the names of robots; none where there is no file."""
    return {row["robot"]: row for row in json.loads(file.read_text())["robots"]} if file and file.exists() else {}


def write(rows: dict[str, Row], file: Path) -> None:
    """Rows in the order of the table of robots, one a line."""
    lines = ",\n".join(json.dumps(rows[name]) for name in ROBOTS if name in rows)
    file.write_text(f'{{"version": "{version()}", "robots": [\n{lines}\n]}}\n')


def version() -> str:
    """Version of the package that is measured, its last commit, and a plus where files of it differ from that."""

    def git(*words: str) -> str:
        said = subprocess.run(["git", *words, "--", "."], cwd=folder, capture_output=True, text=True)
        return said.stdout.strip()

    folder = Path(gp.__file__).resolve().parent
    return f"{gp.__version__} {git('log', '-1', '--format=%h')}{'+' if git('status', '--porcelain') else ''}"


def judged(robots: list[Robot], jobs: int) -> Iterator[Row]:
    """Rows as they are done."""
    work = Path(tempfile.mkdtemp(prefix="bench_"))
    side_by_side = Forks(jobs)
    for _, row in side_by_side(_judged, [(robot, work / robot.name) for robot in robots]):
        yield row


def _judged(call: tuple[Robot, Path]) -> Row:
    return judge(*call)


def main() -> None:
    flags = {"quick": False, "list": False}
    settings = parsed(__doc__, only="", jobs=1, against=RESULTS, results=None, record="", **flags)
    robots = chosen(settings)
    if settings.list:
        print("\n".join(f"{r.name:24} {r.kind:8} {'quick' if r.quick else '':6} {r.why}" for r in robots))
        return
    before, rows = read(settings.against), read(settings.results)
    print(f"{version()} in {Path(gp.__file__).parent}", flush=True)
    for row in judged([robot for robot in robots if robot.name not in rows], settings.jobs):
        rows[row["robot"]] = row
        print(changed(before.get(row["robot"]), row) or f"{row['robot']}: as before", flush=True)
        if settings.results:
            write(rows, settings.results)
    rows = {robot.name: rows[robot.name] for robot in robots}
    print(counted(rows.values()))
    if settings.record:
        write(rows, RESULTS)
        with HISTORY.open("a") as history:
            history.write(line(version(), rows.values(), settings.record))
    sys.exit(any(worse(before[name], row) for name, row in rows.items() if name in before))


if __name__ == "__main__":
    main()
