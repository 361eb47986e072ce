"""Write the tables of a README from the results of its command."""

import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from experiments.methods.rows import Row
from experiments.options import command


def write_table(readme: Path, name: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Replace what stands between ``<!-- name -->`` and ``<!-- end of name -->`` by a table, if the file is there."""
    if not readme.exists():
        return
    lines = [header, ["---"] * len(header), *rows]
    table = "\n".join("| " + " | ".join("" if cell is None else str(cell) for cell in line) + " |" for line in lines)
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    text = readme.read_text(encoding="utf-8")
    before, rest = text.split(begin)
    readme.write_text(f"{before}{begin}\n\n{table}\n\n{end}{rest.split(end)[1]}", encoding="utf-8")


def save_rows(file: Path, head: Mapping[str, object], name: str, rows: Iterable[object]) -> None:
    """Replace a JSON file by a head and a list of rows, one a line."""
    lines = ",\n".join(json.dumps(row) for row in rows)
    file.with_suffix(".part").write_text(f'{json.dumps(head, indent=1)[:-2]},\n "{name}": [\n{lines}\n]}}\n')
    file.with_suffix(".part").replace(file)


Job = tuple[str, int, Callable[[int], Row]]
"""Kind of a machine, its number, and a function that measures the machine of a number."""


def run_jobs(
    file: Path, name: str, jobs: Iterable[Job], seconds: float, summarised: Callable[[list[Row]], Row]
) -> None:
    """Run the jobs whose rows a JSON file lacks, save the file after each, and print the summary.

    No job begins after `seconds`. A row has the number of its machine under the kind of the machine, and its seconds.
    """
    rows: list[Row] = json.loads(file.read_text())[name] if file.exists() else []
    started = time.monotonic()
    for kind, number, ask in jobs:
        begun = time.monotonic()
        if begun - started < seconds and all(row.get(kind) != number for row in rows):
            rows.append(ask(number) | {"seconds": round(time.monotonic() - begun, 1)})
            save_rows(file, {"command": command(), "summary": summarised(rows)}, name, rows)
    print(json.dumps(summarised(rows), indent=1))
