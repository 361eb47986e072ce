"""Compare `discover` on blind robots with an oracle that is given the form of the effect.

From the root of the repository: python -m experiments.blind.run --set open --family memory,masses --results FILE
Results are saved after every robot and a table a family beside them; started again, it leaves out the robots that FILE
has with the same options, and where none is left it writes the tables afresh.
Options it does not know, and all after `--`, go on to `gpmodel discover`; --oracle-only leaves the product out.
--method gives the robots to another method, or several in turn to one FILE.jsonl, with a leaderboard beside it.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import tempfile
from collections.abc import Iterator
from itertools import product
from pathlib import Path

from experiments.blind.cases import CASES, FAMILIES
from experiments.blind.entered import run
from experiments.blind.grading import summarise
from experiments.blind.judge import save, saved
from experiments.blind.product import Asked, Row, judge
from experiments.methods.plug import METHODS
from experiments.options import command
from gpmodel.executor import Forks


def judged(jobs: list[tuple[str, int]], work: Path, workers: int, asked: Asked) -> Iterator[Row]:
    """Rows as they are done: one robot after the other, or several processes side by side."""
    calls = [(name, seed, work / f"{name}_{seed}", asked) for name, seed in jobs]
    side_by_side = Forks(workers)
    for _, row in side_by_side(_judged, calls):
        yield row


def _judged(call: tuple[str, int, Path, Asked]) -> Row:
    return judge(*call)


def chosen(settings: argparse.Namespace) -> list[str]:
    """Names of the cases that the options leave."""
    only, families = settings.only.split(","), settings.family.split(",")
    for names, known in ((only, CASES), (families, FAMILIES)):
        if unknown := set(names) - set(known):
            raise SystemExit(f"unknown: {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    sets = ("open", "aside") if settings.set == "all" else (settings.set,)
    return [n for n in only if CASES[n].family in families and ("aside" if CASES[n].aside else "open") in sets]


def parse() -> tuple[argparse.Namespace, Asked]:
    """Own options, and those of discover: unknown ones and what follows `--`."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("--set", choices=["open", "aside", "all"], default="open")
    parser.add_argument("--family", default=",".join(FAMILIES), help=f"with commas, of {', '.join(FAMILIES)}")
    parser.add_argument("--only", default=",".join(CASES), help="names of cases, with commas")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1, help="robots side by side")
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "blind_robots")
    parser.add_argument("--results", type=Path, help="JSON; the tables go into the same name with .md")
    parser.add_argument("--in-order", default="", help="options of discover for robots where the order matters")
    parser.add_argument(
        "--predict-in-order", default="", help="options of predict where the rows of the session matter"
    )
    parser.add_argument("--oracle-only", action="store_true", help="no product")
    parser.add_argument("--method", help=f"{', '.join(METHODS)}, or package.module:function, in the product's place")
    parser.add_argument("--list", action="store_true", help="only the names of the cases")
    given = sys.argv[1:]
    cut = given.index("--") if "--" in given else len(given)
    settings, options = parser.parse_known_args(given[:cut])
    in_order, predict = (tuple(shlex.split(text)) for text in (settings.in_order, settings.predict_in_order))
    return settings, Asked((*options, *given[cut + 1 :]), in_order, predict, settings.oracle_only)


def main() -> None:
    settings, asked = parse()
    names = chosen(settings)
    if settings.list:
        print("\n".join(f"{n} {CASES[n].family} {'aside' if CASES[n].aside else 'open'}" for n in names))
        return
    seeds = range(settings.first_seed, settings.first_seed + settings.seeds)
    robots = [(name, seed) for seed, name in product(seeds, names)]
    if settings.method:
        run(robots, settings.method, settings.work, settings.results)
        return
    rows = saved(settings.results)
    done = {key for key, row in rows.items() if "failed" not in row and row.get("options") == asked.said()}
    jobs = [robot for robot in robots if robot not in done]
    for row in judged(jobs, settings.work, settings.workers, asked):
        rows[row["case"], row["seed"]] = row
        print(json.dumps({k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()}), flush=True)
        if settings.results:
            save(rows, command(), settings.results)
    if settings.results and not jobs:
        save(rows, command(), settings.results)
    print(json.dumps({"command": command(), **summarise(list(rows.values()))}, indent=1))


if __name__ == "__main__":
    main()
