"""Compare four reports before and after a change that should change no number.

From the root of the repository: python -m experiments.bench.fixed
Compares report.json of the demo and of three small robots with fixed.json, without times, versions and paths; ends with
1 where a number differs by more than 1e-9 of its size, or anything else at all. --record replaces fixed.json.
The last digits depend on processor and libraries: record on the machine that compares.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import gpmodel as gp
from experiments.bench.robots import ROBOTS
from experiments.blind.files import write as write_blind
from experiments.blind.generate import make
from experiments.options import parsed
from experiments.random_laws.judge import write as write_law
from experiments.random_laws.robot import make as make_law
from gpmodel.discovery.search import Search
from gpmodel.report.saved import to_json

FIXED = Path(__file__).parent / "fixed.json"
DIGITS = 1e-9
LEFT_OUT = {"command", "versions", "seconds", "model_sha256", "sha256", "path", "source", "exports", "plots"}
SMALL = ("drift_61", "two_links_30", "law_2_1_7")
RUNS = ("demo", *SMALL)


def record(name: str) -> Any:
    """The report of a run as JSON has it, without what differs from run to run."""
    with tempfile.TemporaryDirectory() as work, as_file(files("gpmodel") / "data" / "demo.csv") as table:
        mechanism: str | Path = "irb6400r"
        search = Search(workers=1)
        if name != "demo":
            robot, folder = ROBOTS[name], Path(work)
            search = replace(search, runs=0)
            table, mechanism = folder / "table.csv", folder / "robot.urdf"
            if robot.case is None:
                write_law(make_law(robot.seed, robot.factors, robot.index), folder)
            else:
                write_blind(make(robot.case, robot.seed), folder)
        found = gp.discover(mechanism, table, search=search)
        return without(json.loads(to_json(found.record)))


def without(value: Any) -> Any:
    """JSON without the keys of `LEFT_OUT`, at any depth."""
    if isinstance(value, dict):
        return {key: without(item) for key, item in value.items() if key not in LEFT_OUT}
    return [without(item) for item in value] if isinstance(value, list) else value


def differences(before: Any, now: Any, at: str = "") -> Iterator[str]:
    """Where two values of JSON differ, and by what."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in sorted({*before, *now}):
            yield from differences(before.get(key), now.get(key), f"{at}.{key}")
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for number, pair in enumerate(zip(before, now, strict=True)):
            yield from differences(*pair, f"{at}[{number}]")
    elif not same(before, now):
        yield f"{at.lstrip('.')}: {json.dumps(before)[:90]} -> {json.dumps(now)[:90]}"


def same(before: Any, now: Any) -> bool:
    """Return whether two leaves are equal, numbers to `DIGITS` of their size."""
    numbers = (int, float)
    if isinstance(before, numbers) and isinstance(now, numbers):
        return math.isclose(before, now, rel_tol=DIGITS, abs_tol=1e-15)
    return bool(before == now)


def main() -> None:
    settings = parsed(__doc__, only=",".join(RUNS), record=False)
    kept: dict[str, Any] = json.loads(FIXED.read_text()) if FIXED.exists() else {}
    changed = False
    for name in settings.only.split(","):
        now = record(name)
        where = list(differences(kept.get(name), now))
        print("\n    ".join([f"{name}: {len(where)} differences", *where[:12]]), flush=True)
        changed |= bool(where)
        kept[name] = now
    if settings.record:
        FIXED.write_text("{\n" + ",\n".join(f'"{n}": {json.dumps(kept[n])}' for n in RUNS if n in kept) + "\n}\n")
    sys.exit(changed and not settings.record)


if __name__ == "__main__":
    main()
