"""Compare a tracker, cameras, a probe, bars and two touching arms on robots with an undeclared effect.

From the root of the repository: python -m experiments.instruments.run [--robots 20] [--kinds camera,bars] [--out FILE].
Every machine is kept when it is finished; a run that was interrupted goes on, and `--robots 30` adds ten.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from experiments.instruments.judge import POSES, judge
from experiments.options import parsed
from experiments.tables import write_table
from gpmodel.files import to_json, write_text

HERE = Path(__file__).parent
Row = dict[str, Any]
GOAL = 1.25
HEADER = (
    "instrument", "poses", "tool, µm", "bound, µm", "ratio, median", "within 1.25", "named", "false of guilty",
    "silent on innocents", "wrong rows found", "right rows taken", "wrong starts converge", "poses for a tracker's 60",
)  # fmt: skip


def summary(rows: list[Row]) -> dict[str, Row]:
    """Counts and medians by instrument. ratios are over all machines; poses_needed: by the bounds, for what 60 poses of
    a tracker tell, as information grows with the poses."""
    out: dict[str, Row] = {}
    tracker = np.median([r["bound_um"] for r in rows if r["kind"] == "tracker" and "ratio" in r] or [np.nan])
    for kind in POSES:
        mine = [r for r in rows if r["kind"] == kind and "ratio" in r]
        guilty, innocent = [r for r in mine if r["guilty"]], [r for r in mine if not r["guilty"]]
        if not mine:
            continue
        least = np.median([r["bound_um"] for r in mine])
        out[kind] = {
            "poses": mine[0]["poses"],
            "um": round(float(np.median([r["um"] for r in mine])), 1),
            "bound_um": round(float(least), 1),
            "ratio": round(float(np.median([r["ratio"] for r in mine])), 2),
            "within": _of([r["ratio"] <= GOAL for r in mine]),
            "named": _of([r["named"] for r in guilty]),
            "false": sum(r["false"] for r in guilty),
            "silent": _of([not r["found"] for r in innocent]),
            "wrong_found": _counted(guilty, "wrong_found", "wrong"),
            "right_taken": sum(r["right_taken"] for r in guilty if "wrong" in r) if _any(guilty, "wrong") else None,
            "converge": _of([r["converges"] for r in guilty]) if _any(guilty, "converges") else None,
            "poses_needed": int(np.ceil(mine[0]["poses"] * (least / tracker) ** 2)) if np.isfinite(tracker) else None,
        }
    return out


def _of(yes: list[bool]) -> str:
    return f"{sum(yes)} of {len(yes)}"


def _any(rows: list[Row], key: str) -> bool:
    return any(key in r for r in rows)


def _counted(rows: list[Row], found: str, there: str) -> str | None:
    asked = [r for r in rows if there in r]
    return f"{sum(r[found] for r in asked)} of {sum(r[there] for r in asked)}" if asked else None


def cells(told: dict[str, Row]) -> list[list[object]]:
    """The table of the README."""
    return [[kind, *row.values()] for kind, row in told.items()]


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    given = parsed(__doc__, arguments, robots=20, kinds=",".join(POSES), out=HERE / "results.json")
    command = f"python -m experiments.instruments.run --robots {given.robots}"
    rows: list[Row] = json.loads(given.out.read_text())["machines"] if given.out.is_file() else []
    known = {(r["kind"], r["seed"], r["guilty"]) for r in rows}
    results: dict[str, Any] = {}
    for seed in range(given.robots):
        for kind in given.kinds.split(","):
            for guilty in (True, False):
                if (kind, seed, guilty) not in known:
                    rows.append(judge(kind, seed, guilty))
                    print(rows[-1], flush=True)
                    results = {"command": command, "summary": summary(rows)}
                    write_text(given.out, to_json({**results, "machines": rows}))
    results = {"command": command, "summary": summary(rows), "machines": rows}
    write_text(given.out, to_json(results))
    write_table(given.out.with_name("README.md"), "instruments", HEADER, cells(results["summary"]))
    return results


if __name__ == "__main__":
    main()
