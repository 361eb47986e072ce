"""The tables of exports in the documents are what the command wrote."""

import json
from pathlib import Path

import pytest

from experiments.exports.geometry import geometry, worst
from experiments.exports.run import cell, table

ROOT = Path(__file__).parents[2]


def test_the_documents_say_what_was_measured() -> None:
    results = json.loads((ROOT / "experiments/exports/results.json").read_text())
    studies, said = results["studies"], (ROOT / "experiments/exports/README.md").read_text()
    assert table(studies) in said
    assert worst(results["geometry"]) in said
    readme = (ROOT / "README.md").read_text()
    rows = {row["file"].removeprefix("exports/"): cell(row) for row in studies["ur5"]}
    for line in readme.splitlines():
        for file in (name for name in rows if f"`exports/{name}`" in line or line.startswith(f"| `{name}`")):
            assert line.endswith(f"| {rows[file]} |"), line


@pytest.mark.long
@pytest.mark.parametrize("arm", ["irb6400r", "wrist.toml", "mimic.urdf", "two_arms.toml", "kinova", "ur10_limited"])
def test_a_file_is_predict_or_refused(arm: str) -> None:
    found = geometry(arm)
    assert isinstance(found["calibrated.urdf"], float)
    assert max(v for v in found.values() if isinstance(v, float)) < 1.0
