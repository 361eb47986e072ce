"""Write the tables of a README from the results of its command."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path


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
