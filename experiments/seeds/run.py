"""Compare the findings of one table at several seeds.

From the root of the repository: python -m experiments.seeds.run --seeds 5 --runs 0 --results FILE.json
Robots are named by kind (experiments.blind), or by factors and number (experiments.random_laws).
"""

from __future__ import annotations

import json
import re
import tempfile
import time
from collections import Counter
from itertools import combinations
from pathlib import Path
from typing import Any

import gpmodel as gp
from experiments.blind import generate
from experiments.blind.files import write as write_blind
from experiments.options import parsed
from experiments.random_laws import robot as laws
from experiments.random_laws.judge import write as write_law

ROBOTS = ("bending_5", "cross_bending_3", "backlash_2", "bump_2", "1/10", "2/15")
"""Single effects of named kinds, 90 to 100 poses; laws that nobody listed, 117 and 95."""
NUMBER = re.compile(r"[0-9]+\.[0-9]+(e-?[0-9]+)?")
"""Constants inside a law: it is the same finding with others."""


def files_of(name: str, folder: Path) -> tuple[Path, Path]:
    """The table and the description of a robot."""
    if "/" not in name:
        write_blind(generate.make(name, 0), folder)
        return folder / "table.csv", folder / "robot.urdf"
    factors, index = map(int, name.split("/"))
    table, urdf, _ = write_law(laws.make(0, factors, index), folder)
    return table, urdf


def found(table: Path, urdf: Path, seed: int, runs: int) -> dict[str, Any]:
    """Names of the findings of one seed, whether they are shipped, and the error said."""
    started = time.perf_counter()
    result = gp.discover(urdf, table, seed=seed, search=gp.Search(runs=runs))
    names = sorted(NUMBER.sub("#", f.name) for f in result.findings)
    passed = result.found.confirmed
    return {
        "seed": seed, "found": names, "shipped": passed, "rms_mm": round(result.rms, 4),
        "seconds": round(time.perf_counter() - started, 1),
    }  # fmt: skip


def agreement(rows: list[dict[str, Any]]) -> dict[str, float]:
    """same: share of the seeds with the commonest set of names; pairs: shared over all names, mean over pairs of seeds;
    verdict: share with the commonest answer to whether it is shipped."""
    sets = [frozenset(row["found"]) for row in rows]
    pairs = [len(a & b) / len(a | b) if a | b else 1.0 for a, b in combinations(sets, 2)]
    shipped = Counter(row["shipped"] for row in rows)
    return {
        "same": Counter(sets).most_common(1)[0][1] / len(rows), "pairs": sum(pairs) / max(len(pairs), 1),
        "verdict": shipped.most_common(1)[0][1] / len(rows),
    }  # fmt: skip


def main() -> None:
    given = parsed(__doc__, seeds=5, runs=0, robots=",".join(ROBOTS), results=None)
    out: dict[str, Any] = {}
    for name in given.robots.split(","):
        with tempfile.TemporaryDirectory() as folder:
            table, urdf = files_of(name, Path(folder))
            rows = [found(table, urdf, seed, given.runs) for seed in range(given.seeds)]
        out[name] = {**agreement(rows), "rows": rows}
        print(name, json.dumps(out[name], ensure_ascii=False), flush=True)
    keys = ("same", "pairs", "verdict")
    out["all"] = {key: sum(robot[key] for robot in out.values()) / len(out) for key in keys}
    print("all", out["all"])
    if given.results:
        given.results.write_text(json.dumps(out, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
