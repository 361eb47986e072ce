"""Import files as instruments and controllers write them, and count right, refused and wrong imports.

From the root of the repository: python -m experiments.layouts.run [--only NAME] [--out FOLDER]
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from click.testing import CliRunner

import gpmodel as gp
from experiments.layouts.later import LATER
from experiments.layouts.written import WRITTEN, Case
from experiments.options import parsed
from gpmodel.cli.import_ import import_table
from gpmodel.errors import InputError
from gpmodel.report.origin import versions

SAME_DEG, SAME_MM = 2e-4, 2e-2
"""Differences from the truth that digits make."""


def judged(make: Callable[[Path], Case]) -> dict[str, Any]:
    """Import the files of a layout, and say what came of it."""
    with tempfile.TemporaryDirectory() as name:
        case = make(Path(name))
        made = Path(name) / "out" / "table.csv"
        files, again = [*map(str, case.files)], made.with_name("again.csv")
        words = [*files, "--mechanism", case.arm, "--guess", "--out", str(made), "--quiet"]
        done = CliRunner().invoke(import_table, words)
        row = {"layout": (make.__doc__ or "").strip(), "files": len(files)}
        if done.exception is not None:
            outcome = (
                "defect" if not isinstance(done.exception, InputError) else "right" if case.truth is None else "refused"
            )
            return row | {"outcome": outcome, "said": str(done.exception)}
        CliRunner().invoke(import_table, [*files, "--map", str(made.with_suffix(".map.toml")), "--out", str(again)])
        try:
            wrong = flaw(made, case)
        except InputError as error:
            wrong = f"the table cannot be read: {error}"
        if not wrong and (not again.exists() or again.read_text() != made.read_text()):
            wrong = "the map does not repeat the import"
        return row | {"outcome": "wrong" if wrong else "right", "said": wrong}


def flaw(made: Path, case: Case) -> str:
    """Say what of a table differs from the truth; nothing where it is right."""
    if case.truth is None:
        return "what is to be refused is taken"
    truth, told = case.truth, case.told
    data = gp.read_table(made, truth.mechanism)
    if len(data) != told * len(truth.q):
        return f"{len(data)} rows, expected {told * len(truth.q)}"
    points = np.stack([truth.p, truth.second], axis=1)[:, :told].reshape(-1, 3)
    off = float(np.abs(np.degrees(data.q) - np.repeat(truth.q, told, axis=0)).max())
    away = np.abs(1e3 * data.position - points)
    if off > SAME_DEG or not away[np.isfinite(away)].max() < SAME_MM:
        return f"joint values differ by {off:.2g} deg, positions by {np.nanmax(away):.2g} mm"
    findings = [remark.text for remark in gp.check(truth.mechanism, data).findings if remark.severity == "error"]
    return "; ".join(findings)


def main() -> None:
    """Write results.json and the table of the README."""
    given = parsed(__doc__, only="", out=Path(__file__).parent)
    rows = []
    for part, layouts in (("before", WRITTEN), ("after", LATER)):
        for make in layouts:
            if not given.only or make.__name__ in given.only.split(","):
                rows.append({"written": part} | judged(make))
                print(json.dumps(rows[-1], ensure_ascii=False), flush=True)
    counts = {o: sum(row["outcome"] == o for row in rows) for o in ("right", "refused", "wrong", "defect")}
    print(counts)
    if not given.only:
        origin = {"command": "python -m experiments.layouts.run", "versions": versions()}
        text = json.dumps({**origin, "counts": counts, "layouts": rows}, indent=1)
        (given.out / "results.json").write_text(f"{text}\n")


if __name__ == "__main__":
    main()
