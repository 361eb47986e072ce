"""Run a method on robots with a random formula and compare it with exact positions.

From the root of the repository:
python -m experiments.random_laws.run --factors one,two,weighted,product,sum,waves --seeds 0,1 --results FILE.jsonl
A line is added to FILE after every robot and the leaderboard of all its methods written beside it; the same command
again goes on with what is left.  Odd seeds are aside: of their robots only counts are shown and saved, unless --show is
given.
--factors: names of `law.GRAMMARS`. --method: a name of `methods.plug.METHODS`, or package.module:function. --first:
index of the first robot of every seed. No robot is begun after --minutes.
"""

from __future__ import annotations

import tempfile
import time
from itertools import product
from pathlib import Path

from experiments.methods.plug import folder_name, leaderboard, method_named, write
from experiments.methods.rows import Row, append, rounded, saved
from experiments.options import parsed
from experiments.random_laws.judge import judge
from experiments.random_laws.law import GRAMMARS
from experiments.random_laws.robot import factors_of, is_aside

SHORT = (
    "method", "seed", "factors", "index", "arm", "poses", "law", "place", "geometry_mm", "oracle_mm", "error_mm",
    "ratio", "explained", "false", "found", "seconds", "failed",
)  # fmt: skip
TELLING = ("law", "inputs", "place", "arm", "kind")


def shown(row: Row, show: bool) -> Row:
    """A row as it may be kept: of a robot for a last look nothing that tells which it is."""
    if show or not is_aside(row["seed"]):
        return row
    hidden = [{k: f[k] for k in ("inputs", "nodes", "named", "found_by")} for f in row.get("found", [])]
    return {k: v for k, v in row.items() if k not in TELLING} | ({"found": hidden} if "found" in row else {})


def group(row: Row) -> str:
    """The board on which a robot counts."""
    return GRAMMARS[row["factors"]].title


def main() -> None:
    settings = parsed(
        __doc__, method="discover", factors="1,2", seeds="0", first=0, robots=10, minutes=float("inf"), results=None,
        work=Path(tempfile.gettempdir()) / "random_laws", show=False,
    )  # fmt: skip
    method = method_named(settings.method)
    rows = saved(settings.results)
    until = time.monotonic() + 60 * settings.minutes
    indices = range(settings.first, settings.first + settings.robots)
    seeds = [int(word) for word in settings.seeds.split(",")]
    for index, seed, factor in product(indices, seeds, factors_of(settings.factors)):
        if (identity := (settings.method, seed, factor, index)) in rows or time.monotonic() > until:
            continue
        folder = settings.work / "_".join(map(str, (folder_name(settings.method), seed, factor, index)))
        row = shown({"method": settings.method, **judge(seed, factor, index, method, folder)}, settings.show)
        rows[identity] = row
        if settings.show or not is_aside(seed):
            print(rounded({k: row[k] for k in SHORT if k in row}), flush=True)
        if settings.results:
            append(row, settings.results)
            write(rows.values(), group, settings.results)
    if settings.results and rows:
        write(rows.values(), group, settings.results)
    print(leaderboard(rows.values(), group))


if __name__ == "__main__":
    main()
