"""Count the findings by maker: catalogue, smooth term, founder, bred formula, evolved program.

From the root of the repository:
python -m experiments.methods.makers FILE...
FILE: rows of a benchmark (.jsonl, `found_by` of every finding), or report.json of a discovery. A line for each board of
rows (method and law), one for all reports, and one for the total. Findings saved without a maker are counted apart.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from gpmodel.families.candidate import BRED, CATALOGUE, FORMULA, FORMULA_OF_PROGRAM, NAMED, SEQUENCE, SMOOTH_TERM, TREE

COLUMNS = {
    "catalogue": (CATALOGUE, NAMED), "smooth term": (SMOOTH_TERM,), "founder": (FORMULA,), "bred": BRED,
    "of a program": (FORMULA_OF_PROGRAM,), "program": (SEQUENCE, TREE), "maker not saved": ("",),
}  # fmt: skip
"""Makers of each column."""


def makers_in(file: Path) -> Iterator[tuple[str, str]]:
    """Yield the board and the maker of every finding in a file."""
    if file.suffix == ".jsonl":
        for row in map(json.loads, file.read_text(encoding="utf-8").splitlines()):
            board = f"{row['method']}: {row.get('factors', row.get('case'))}"
            yield from ((board, finding.get("found_by", "")) for finding in row.get("found", ()))
    else:
        effects = json.loads(file.read_text(encoding="utf-8"))["effects"]
        yield from (("reports", effect["found_by"]) for effect in effects if effect["kept"])


def table(makers: Iterable[tuple[str, str]]) -> str:
    """Format findings and their shares by maker, one line for each board and one for the total."""
    counts: dict[str, Counter[str]] = {}
    for board, maker in makers:
        for line in (board, "total"):
            counts.setdefault(line, Counter())[maker] += 1
    shown = sorted(counts, key=lambda board: (board == "total", board))
    lines = ["", "findings", *COLUMNS], ["---"] * (2 + len(COLUMNS)), *(_cells(board, counts[board]) for board in shown)
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _cells(board: str, makers: Counter[str]) -> list[str]:
    whole = makers.total()
    parts = [sum(makers[maker] for maker in some) for some in COLUMNS.values()]
    return [board, str(whole), *(f"{part} ({part / whole:.0%})" if part else "" for part in parts)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    print(table(found for file in parser.parse_args().files for found in makers_in(file)))


if __name__ == "__main__":
    main()
