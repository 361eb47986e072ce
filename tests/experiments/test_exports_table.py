"""The tables of exports in the documents are what the command wrote."""

import json
from pathlib import Path

from experiments.exports.run import cell, table

ROOT = Path(__file__).parents[2]


def test_the_documents_say_what_was_measured() -> None:
    studies = json.loads((ROOT / "experiments/exports/results.json").read_text())["studies"]
    assert table(studies) in (ROOT / "experiments/exports/README.md").read_text()
    readme = (ROOT / "README.md").read_text()
    rows = {row["file"].removeprefix("exports/"): cell(row) for row in studies["ur5"]}
    for line in readme.splitlines():
        for file in (name for name in rows if f"`exports/{name}`" in line or line.startswith(f"| `{name}`")):
            assert line.endswith(f"| {rows[file]} |"), line
