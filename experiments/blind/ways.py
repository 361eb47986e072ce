"""Compare the catalogue alone, genetic programming alone, and both on equal blind robots.

From the root of the repository: python -m experiments.blind.ways --first-seed 10 --results FILE
Each robot is searched in all ways before the next robot. A repeated command continues. `--ways "catalogue alone"`
fills one column. The table is written beside FILE.
"""

from __future__ import annotations

import json
import tempfile
from itertools import product
from pathlib import Path
from statistics import median
from typing import Any

from experiments.blind.cases import CASES
from experiments.blind.grading import summarise
from experiments.blind.judge import line, number, rule
from experiments.blind.product import Asked, Row, judge
from experiments.options import command, parsed
from gpmodel.executor import Forks

WAYS = {"catalogue alone": ("--runs", "0"), "programs alone": ("--no-catalogue",), "both": ()}
ROBOTS = (
    "compliance_2", "last_move_3", "range_offset", "four_150", "student", "bump_2", "massless_ur", "null_columns",
    "ripple_101", "product_2_4", "repeats_jitter", "setup_step", "lag_link", "wrong_masses_kuka", "windup_3", "narrow",
    "six_150", "gear_4_twice", "tracker_drift", "rail_straightness", "curves_ur",
)  # fmt: skip
"""Open robots of every family but `range`, mixed, so that fewer of them are still of many families."""
COUNTS = (
    "robots", "within_goal", "median_ratio", "worst_ratio", "within_goal_exact", "median_ratio_exact",
    "worst_ratio_exact", "worse_than_standard", "effects_named", "effects", "false_additions", "readable", "findings",
)  # fmt: skip


def main() -> None:
    work = Path(tempfile.gettempdir()) / "blind_ways"
    names = {"only": ",".join(ROBOTS), "ways": ",".join(WAYS)}
    settings = parsed(__doc__, **names, seeds=1, first_seed=0, workers=1, work=work, results=Path)
    rows = json.loads(settings.results.read_text())["robots"] if settings.results.exists() else []
    done = {(row["case"], row["seed"], row["way"]) for row in rows if "failed" not in row}
    rows = [row for row in rows if "failed" not in row]
    seeds = range(settings.first_seed, settings.first_seed + settings.seeds)
    asked = product(seeds, settings.only.split(","), settings.ways.split(","))
    calls = [(name, seed, way, settings.work) for seed, name, way in asked if (name, seed, way) not in done]
    side_by_side = Forks(settings.workers)
    for _, row in side_by_side(judged, calls):
        rows.append(row)
        print(json.dumps(row), flush=True)
        save(rows, command(), settings.results)


def judged(call: tuple[str, int, str, Path]) -> Row:
    """One robot looked at in one way."""
    name, seed, way, work = call
    asked = Asked(WAYS[way], ("--in-order",), ("--session", "--in-order"))
    return {"way": way, **judge(name, seed, work / f"{name}_{seed}_{way.split()[0]}", asked)}


def save(rows: list[Row], said: str, file: Path) -> None:
    """Rows and counts as they stand, in JSON, and as Markdown."""
    summary = {way: counted([row for row in rows if row["way"] == way]) for way in WAYS}
    summary = {way: counts for way, counts in summary.items() if counts}
    results = json.dumps({"command": said, "summary": summary, "robots": rows}, indent=1) + "\n"
    for path, text in ((file, results), (file.with_suffix(".md"), markdown(rows, summary))):
        part = path.with_name(path.name + ".part")
        part.write_text(text)
        part.replace(path)


def counted(rows: list[Row]) -> dict[str, Any]:
    """Counts over the robots of one way, and the seconds of its middle one; empty without any."""
    counts = summarise(rows)
    seconds = [row["seconds"] for row in rows if "seconds" in row]
    return {**{key: counts[key] for key in COUNTS}, "median_seconds": median(seconds)} if seconds else {}


def markdown(rows: list[Row], summary: dict[str, dict[str, Any]]) -> str:
    """Counts over all robots, a column a way, then error over the oracle's and findings of each robot."""
    ways = tuple(summary)
    lines = [line(("", *ways)), rule(1 + len(ways))]
    keys = (*COUNTS, "median_seconds")
    lines += [line((key.replace("_", " "), *(number(summary[way][key]) for way in ways))) for key in keys]
    lines += ["", line(("robot", "family", *ways)), rule(2 + len(ways))]
    found = {(row["case"], row["seed"], row["way"]): row for row in rows}
    for case, seed in dict.fromkeys((row["case"], row["seed"]) for row in rows):
        cells = (_robot(found.get((case, seed, way))) for way in ways)
        lines.append(line((f"{case} {seed}", CASES[case].family, *cells)))
    return "\n".join([*lines, ""])


def _robot(row: Row | None) -> str:
    """Error over the oracle's, in brackets against exact positions, effects named of those there are, and false
    additions where there are any."""
    if row is None:
        return ""
    if "failed" in row:
        return "failed"
    false = f", {row['false']} false" if row["false"] else ""
    return f"{row['ratio_noisy']:.3f} ({row['ratio_clean']:.2f}), {row['effects_named']} of {row['effects']}{false}"


if __name__ == "__main__":
    main()
