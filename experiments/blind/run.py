"""Give blind robots to the product and compare what it finds with an oracle that is told the effect's form.

From the root of the repository: python -m experiments.blind.run --set open --family memory,masses --results FILE
Results are saved after every robot and a table a family beside them; robots that FILE has already are left out.
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
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.blind.cases import CASES, FAMILIES
from experiments.blind.files import write
from experiments.blind.generate import make
from experiments.blind.grading import grade, summarise, worse
from experiments.blind.oracle import rms_mm
from experiments.blind.tables import markdown

PROGRAM = str(Path(sys.executable).with_name("gpmodel"))
Row = dict[str, Any]


def positions(table: Path | io.StringIO) -> np.ndarray:
    return pd.read_csv(table)[["x [mm]", "y [mm]", "z [mm]"]].to_numpy()


def program(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True)


def predict(model: Path, folder: Path, name: str) -> np.ndarray:
    """(N, 3) mm: the table `gpmodel predict` leaves in its folder, or prints."""
    out = folder / "predicted" / name
    run = program("predict", model, folder / f"{name}.csv", "--out", out)
    if run.returncode:
        raise RuntimeError(f"predict failed: {(run.stderr.strip().splitlines() or ['no message'])[-1]}")
    tables = [out] if out.is_file() else sorted(out.glob("*.csv"))
    return positions(tables[0]) if tables else positions(io.StringIO(run.stdout))


def errors_on(names: list[str], where: str, folder: Path, errors: dict[str, float]) -> Row:
    """What the product predicts for some files, against where they are, were measured, and the geometric fit."""
    predicted = [predict(folder / "out" / "model.json", folder, name) for name in names]
    off = {
        kind: np.vstack([p - positions(folder / f"{n}_{kind}.csv") for p, n in zip(predicted, names, strict=True)])
        for kind in ("clean", "noisy")
    }
    row: Row = {}
    for kind, error in off.items():
        row[f"product_{where}{kind}_mm"] = rms_mm(error / 1e3)
        row[f"ratio_{where}{kind}"] = row[f"product_{where}{kind}_mm"] / errors[f"oracle_{where}{kind}_mm"]
    row[f"ratio_{where}standard"] = row[f"product_{where}noisy_mm"] / errors[f"geometric_{where}noisy_mm"]
    plain = [positions(folder / f"{n}_standard.csv") - positions(folder / f"{n}_noisy.csv") for n in names]
    return {**row, f"{where}worse": worse(off["noisy"], np.vstack(plain))}


def judge(name: str, seed: int, folder: Path, options: list[str]) -> Row:
    """One robot from nothing to its row of results."""
    shutil.rmtree(folder, ignore_errors=True)
    truth = write(make(name, seed), folder, judged=True)
    row: Row = {"case": name, "seed": seed, **truth["errors"]}
    if "--oracle-only" in options:
        return row
    told = [o for o in options if o != "--tell-order"]
    if "--tell-order" in options and CASES[name].in_order:
        told.append("--in-order")
    started = time.perf_counter()
    paths = (folder / "table.csv", "--mechanism", folder / "robot.urdf", "--out", folder / "out")
    run = program("discover", *paths, "--quiet", *([] if "--seed" in told else ["--seed", 0]), *told)
    row["seconds"] = round(time.perf_counter() - started, 1)
    if run.returncode:
        return {**row, "failed": (run.stderr.strip().splitlines() or ["no message"])[-1]}
    try:
        for where in ("fresh", "beyond"):
            if truth[where]:
                row |= errors_on(truth[where], "" if where == "fresh" else "beyond_", folder, truth["errors"])
    except RuntimeError as error:
        return {**row, "failed": str(error)}
    return {**row, **grade(json.loads((folder / "out" / "report.json").read_text())["effects"], truth)}


def judged(jobs: list[tuple[str, int]], settings: argparse.Namespace, options: list[str]) -> Iterator[Row]:
    """Rows as they are done: one robot after the other, or several processes side by side."""
    calls = [(name, seed, settings.work / f"{name}_{seed}", options) for name, seed in jobs]
    if settings.workers == 1:
        yield from (judge(*call) for call in calls)
        return
    with ProcessPoolExecutor(settings.workers) as pool:
        for future in as_completed([pool.submit(judge, *call) for call in calls]):
            yield future.result()


def chosen(settings: argparse.Namespace) -> list[str]:
    """Names of the cases that the options leave."""
    only, families = settings.only.split(","), settings.family.split(",")
    for name, known in ((only, CASES), (families, FAMILIES)):
        if unknown := set(name) - set(known):
            raise SystemExit(f"unknown: {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    sets = ("open", "aside") if settings.set == "all" else (settings.set,)
    return [n for n in only if CASES[n].family in families and ("aside" if CASES[n].aside else "open") in sets]


def parse() -> tuple[argparse.Namespace, list[str]]:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--set", choices=["open", "aside", "all"], default="open")
    parser.add_argument("--family", default=",".join(FAMILIES), help=f"with commas, of {', '.join(FAMILIES)}")
    parser.add_argument("--only", default=",".join(CASES), help="names of cases, with commas")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1, help="robots side by side")
    parser.add_argument("--work", type=Path, default=Path(tempfile.gettempdir()) / "blind_robots")
    parser.add_argument("--results", type=Path, help="JSON; the tables go into the same name with .md")
    parser.add_argument("--tell-order", action="store_true", help="discover --in-order where the order matters")
    parser.add_argument("--list", action="store_true", help="only the names of the cases")
    return parser.parse_known_args()


def main() -> None:
    settings, options = parse()
    options += ["--tell-order"] if settings.tell_order else []
    names = chosen(settings)
    if settings.list:
        print("\n".join(f"{n} {CASES[n].family} {'aside' if CASES[n].aside else 'open'}" for n in names))
        return
    saved = settings.results is not None and settings.results.exists()
    rows: list[Row] = json.loads(settings.results.read_text())["robots"] if saved else []
    done = {(row["case"], row["seed"]) for row in rows}
    seeds = range(settings.first_seed, settings.first_seed + settings.seeds)
    command = " ".join(["python -m experiments.blind.run", *sys.argv[1:]])
    for row in judged([job for job in product(names, seeds) if job not in done], settings, options):
        rows.append(row)
        print(json.dumps({k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()}), flush=True)
        if settings.results:
            save(rows, command, settings.results)
    print(json.dumps({"command": command, **summarise(rows)}, indent=1))


def save(rows: list[Row], command: str, file: Path) -> None:
    """Results and tables as they stand; a kill leaves the last ones whole."""
    rows = sorted(rows, key=lambda row: (list(CASES).index(row["case"]), row["seed"]))
    text = json.dumps({"summary": {"command": command, **summarise(rows)}, "robots": rows}, indent=1) + "\n"
    for path, content in ((file, text), (file.with_suffix(".md"), markdown(rows, command))):
        part = path.with_name(path.name + ".part")
        part.write_text(content)
        part.replace(path)


if __name__ == "__main__":
    main()
