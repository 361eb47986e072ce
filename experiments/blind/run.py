"""Give blind robots to the product and compare what it finds with an oracle that is told the effect's form.

From the root of the repository: python -m experiments.blind.run --set open --seeds 2 --results FILE
Options it does not know go on to `gpmodel discover`; --oracle-only leaves the product out.
"""

from __future__ import annotations

import argparse
import io
import json
import shutil
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.blind.cases import CASES
from experiments.blind.generate import make, write
from experiments.blind.grading import answers, innocent, summarise
from experiments.blind.oracle import rms_mm

PROGRAM = str(Path(sys.executable).with_name("gpmodel"))


def positions(table: Path | io.StringIO) -> np.ndarray:
    return pd.read_csv(table)[["x [mm]", "y [mm]", "z [mm]"]].to_numpy()


def program(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True)


def predict(model: Path, folder: Path, name: str) -> np.ndarray:
    """(N, 3) mm: the table `gpmodel predict` leaves in its folder, or prints."""
    out = folder / "predicted" / name
    run = program("predict", model, folder / f"{name}.csv", "--out", out)
    if run.returncode:
        raise SystemExit(f"{folder}: predict failed: {run.stderr.strip()}")
    tables = [out] if out.is_file() else sorted(out.glob("*.csv"))
    return positions(tables[0]) if tables else positions(io.StringIO(run.stdout))


def judge(name: str, seed: int, folder: Path, options: list[str]) -> dict[str, Any]:
    shutil.rmtree(folder, ignore_errors=True)
    truth = write(make(CASES[name], seed), folder)
    row: dict[str, Any] = {"case": name, "seed": seed, **truth["errors"]}
    if "--oracle-only" in options:
        return row
    started = time.perf_counter()
    out, mechanism = folder / "out", folder / "robot.urdf"
    run = program(
        "discover", folder / "table.csv", "--mechanism", mechanism, "--out", out, "--quiet", "--seed", 0, *options
    )
    row["seconds"] = round(time.perf_counter() - started, 1)
    if run.returncode:
        return {**row, "failed": (run.stderr.strip().splitlines() or ["no message"])[-1]}
    effects = json.loads((out / "report.json").read_text())["effects"]
    predicted = np.vstack([predict(out / "model.json", folder, f) for f in truth["fresh"]])
    for kind in ("clean", "noisy"):
        error = predicted - np.vstack([positions(folder / f"{f}_{kind}.csv") for f in truth["fresh"]])
        row[f"product_{kind}_mm"] = rms_mm(error / 1e3)
        row[f"ratio_{kind}"] = row[f"product_{kind}_mm"] / row[f"oracle_{kind}_mm"]
    found = [name for effect in effects for name in effect["inputs"]]
    row["found"] = [f"{effect['name']} @ {effect['slot']}" for effect in effects]
    row["named"] = all(answers(effect["named"], found) for effect in truth["effects"])
    row["false"] = sum(innocent(effect["inputs"], truth["effects"]) for effect in effects)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--set", choices=["open", "aside", "all"], default="open")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--only", default=",".join(CASES), help="names of cases, with commas")
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "blind_robots")
    parser.add_argument("--results", type=Path)
    settings, options = parser.parse_known_args()
    rows = []
    names = [n for n in settings.only.split(",") if settings.set in ("all", "aside" if CASES[n].aside else "open")]
    for name, seed in product(names, range(settings.first_seed, settings.first_seed + settings.seeds)):
        rows.append(row := judge(name, seed, settings.work / f"{name}_{seed}", options))
        print(json.dumps({k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()}), flush=True)
    summary = {"command": " ".join(["python -m experiments.blind.run", *sys.argv[1:]]), **summarise(rows)}
    print(json.dumps(summary, indent=1))
    if settings.results:
        settings.results.write_text(json.dumps({"summary": summary, "robots": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
