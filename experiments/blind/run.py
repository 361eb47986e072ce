"""Give blind robots to the product and compare what it finds with an oracle that is told the effect's form.

From the root of the repository: python -m experiments.blind.run --set open --family memory,masses --results FILE
Results are saved after every robot and a table a family beside them; started again, it leaves out the robots that FILE
has with the same options.
Options it does not know go on to `gpmodel discover`; --oracle-only leaves the product out.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
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
LONGEST_S = 3600
Row = dict[str, Any]


def positions(table: Path) -> np.ndarray:
    return pd.read_csv(table)[["x [mm]", "y [mm]", "z [mm]"]].to_numpy()


def program(*arguments: object) -> None:
    """Run the product; RuntimeError with the last line it said where it fails or takes an hour."""
    try:
        run = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"{arguments[0]}: no answer in {LONGEST_S} s") from None
    if run.returncode:
        raise RuntimeError(f"{arguments[0]}: {(run.stderr.strip().splitlines() or ['no message'])[-1]}")


def predict(folder: Path, name: str, options: list[str]) -> np.ndarray:
    """(N, 3) mm: the table `gpmodel predict` leaves."""
    out = folder / "predicted" / name
    program("predict", folder / "out" / "model.json", folder / f"{name}.csv", "--out", out, *options)
    return positions(out if out.is_file() else min(out.glob("*.csv")))


def errors_on(names: list[str], where: str, folder: Path, errors: dict[str, float], options: list[str]) -> Row:
    """What the product predicts for some files, against where they are, were measured, and the geometric fit."""
    predicted = [predict(folder, name, options) for name in names]
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


@dataclass(frozen=True)
class Product:
    """How the product is asked: options of discover; those of discover and predict where the order of rows matters."""

    options: list[str]
    in_order: list[str]
    predict_in_order: list[str]

    @property
    def left_out(self) -> bool:
        return "--oracle-only" in self.options

    def said(self) -> str:
        return " | ".join(shlex.join(part) for part in (self.options, self.in_order, self.predict_in_order)).strip(" |")


def judge(name: str, seed: int, folder: Path, asked: Product) -> Row:
    """One robot from nothing to its row of results."""
    shutil.rmtree(folder, ignore_errors=True)
    robot = make(name, seed)
    truth = write(robot, folder, judged=True)
    row: Row = {"case": name, "seed": seed, "options": asked.said(), **truth["errors"]}
    if asked.left_out:
        return row
    discover = [*([] if "--seed" in asked.options else ["--seed", 0]), *asked.options]
    discover += asked.in_order if robot.case.in_order else []
    paths = (folder / "table.csv", "--mechanism", folder / "robot.urdf", "--out", folder / "out")
    started = time.perf_counter()
    try:
        program("discover", *paths, "--quiet", *discover)
        row["seconds"] = round(time.perf_counter() - started, 1)
        for where, names in (("", truth["fresh"]), ("beyond_", truth["beyond"])):
            later = asked.predict_in_order if robot.by_row else []
            row |= errors_on(names, where, folder, truth["errors"], later) if names else {}
    except RuntimeError as error:
        return {**row, "failed": str(error)}
    return {**row, **grade(json.loads((folder / "out" / "report.json").read_text())["effects"], truth)}


def judged(jobs: list[tuple[str, int]], work: Path, workers: int, asked: Product) -> Iterator[Row]:
    """Rows as they are done: one robot after the other, or several processes side by side."""
    calls = [(name, seed, work / f"{name}_{seed}", asked) for name, seed in jobs]
    if workers == 1:
        yield from (judge(*call) for call in calls)
        return
    with ProcessPoolExecutor(workers) as pool:
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
    parser.add_argument("--in-order", default="", help="options of discover for robots where the order matters")
    parser.add_argument(
        "--predict-in-order", default="", help="options of predict where the rows of the session matter"
    )
    parser.add_argument("--list", action="store_true", help="only the names of the cases")
    return parser.parse_known_args()


def main() -> None:
    settings, options = parse()
    names = chosen(settings)
    if settings.list:
        print("\n".join(f"{n} {CASES[n].family} {'aside' if CASES[n].aside else 'open'}" for n in names))
        return
    asked = Product(options, shlex.split(settings.in_order), shlex.split(settings.predict_in_order))
    jobs = list(product(names, range(settings.first_seed, settings.first_seed + settings.seeds)))
    rows = saved(settings.results)
    done = {key for key, row in rows.items() if "failed" not in row and row.get("options") == asked.said()}
    command = shlex.join(["python", "-m", "experiments.blind.run", *sys.argv[1:]])
    for row in judged([job for job in jobs if job not in done], settings.work, settings.workers, asked):
        rows[row["case"], row["seed"]] = row
        print(json.dumps({k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()}), flush=True)
        if settings.results:
            save(rows, command, settings.results)
    print(json.dumps({"command": command, **summarise(list(rows.values()))}, indent=1))


def saved(file: Path | None) -> dict[tuple[str, int], Row]:
    """Rows of an earlier run, by case and seed."""
    if file is None or not file.exists():
        return {}
    return {(row["case"], row["seed"]): row for row in json.loads(file.read_text())["robots"]}


def save(found: dict[tuple[str, int], Row], command: str, file: Path) -> None:
    """Results and tables as they stand; a kill leaves the last ones whole."""
    order = list(CASES)
    rows = [found[key] for key in sorted(found, key=lambda key: (order.index(key[0]), key[1]))]
    text = json.dumps({"summary": {"command": command, **summarise(rows)}, "robots": rows}, indent=1) + "\n"
    for path, content in ((file, text), (file.with_suffix(".md"), markdown(rows, command))):
        part = path.with_name(path.name + ".part")
        part.write_text(content)
        part.replace(path)


if __name__ == "__main__":
    main()
