"""Measure the coverage of intervals, false findings, and models worse than the standard model.

From the root of the repository: python -m experiments.coverage --family known,dependent --seeds 6 --out FILE
`--quick`: one robot of each case and groups alone, without genetic programming. Results are saved after every robot;
started again, it leaves out the robots that FILE has.
"""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np

from experiments.coverage.measure import FAMILIES, Row, found, known
from experiments.options import command, parsed
from experiments.tables import save_rows
from gpmodel.discovery.search import Search
from gpmodel.executor import Forks


def main() -> None:
    names = {"family": ",".join(FAMILIES), "only": ""}
    settings = parsed(__doc__, **names, seeds=6, first_seed=0, runs=0, quick=False, workers=1, out=None)
    seeds = range(settings.first_seed, settings.first_seed + (1 if settings.quick else settings.seeds))
    rows = json.loads(settings.out.read_text())["robots"] if settings.out and settings.out.exists() else []
    done = {(row["case"], row["seed"]) for row in rows}
    jobs = [
        (family, name, seed, settings.runs)
        for seed in seeds
        for family in settings.family.split(",")
        for name in FAMILIES[family]
        if (name, seed) not in done and (not settings.only or name in settings.only.split(","))
    ]
    side_by_side = Forks(settings.workers)
    for _, row in side_by_side(judged, jobs):
        rows.append(row)
        if settings.out:
            save_rows(settings.out, {"command": command(), "summary": summarised(rows)}, "robots", rows)
    print(json.dumps(summarised(rows), indent=1))


def judged(job: tuple[str, str, int, int]) -> Row:
    """One robot: its family, its name, its seed, and the GP runs that a discovery takes."""
    family, name, seed, runs = job
    case, started = FAMILIES[family][name], time.process_time()
    row = known(case, seed) if family == "known" else found(case, seed, Search(runs=runs))
    spent = round(time.process_time() - started, 1)
    return {"case": name, "seed": seed, "family": family, "processor_s": spent, **row}


def summarised(rows: list[Row]) -> dict[str, Any]:
    """Counts over each family, of `known` over each way of measuring."""
    return {kind: counted(own) for kind, own in _grouped(rows).items()}


def _grouped(rows: list[Row]) -> dict[str, list[Row]]:
    out: dict[str, list[Row]] = {}
    for row in rows:
        kind = f"known, {row['case'].split(' ')[1]}" if row["family"] == "known" else row["family"]
        out.setdefault(kind, []).append(row)
    return out


def counted(rows: list[Row]) -> dict[str, Any]:
    """Coverage of ± 2 σ by numbers of the geometry, of effects and by predicted coordinates; additions; comparisons."""
    out: dict[str, Any] = {"robots": len(rows)}
    for key in ("geometry", "effect", "robust", "deviations", "told"):
        values = [abs(v) for row in rows for v in row.get(key, [])]
        if values:
            out[key] = {"numbers": len(values), "within": round(float(np.mean(np.array(values) <= 2.0)), 3)}
    out["predictions within"] = round(float(np.mean([row["within"] for row in rows])), 3)
    if "false" in rows[0]:
        adding = [f"{row['case']} {row['seed']}: {'; '.join(row['found'])}" for row in rows if row["false"]]
        out["false additions"] = {"count": sum(row["false"] for row in rows), "robots": adding}
        held = {f"{row['case']} {row['seed']}": row["stopped"] for row in rows if row.get("stopped")}
        out["stopped by the tests of dependence alone"] = held
        out["unconfirmed"] = sum(not row["confirmed"] for row in rows)
        out["worse"] = [f"{row['case']} {row['seed']}" for row in rows if row["worse"]]
        out["better"] = sum(row["better"] for row in rows)
        out["fresh over standard, worst"] = round(max(row["fresh_mm"] / row["standard_mm"] for row in rows), 3)
    return out


if __name__ == "__main__":
    main()
