"""Run gpmodel on one blind robot like a user, and grade the result."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.blind.files import write
from experiments.blind.generate import make
from experiments.blind.grading import grade, worse
from experiments.blind.oracle import rms_mm

PROGRAM = str(Path(sys.executable).with_name("gpmodel"))
LONGEST_S = 3600
Row = dict[str, Any]


@dataclass(frozen=True)
class Asked:
    """Options of discover; those it has besides where the order of rows matters; those of predict where the rows of the
    session do.  oracle_only: nothing is asked."""

    options: tuple[str, ...] = ()
    in_order: tuple[str, ...] = ()
    predict_in_order: tuple[str, ...] = ()
    oracle_only: bool = False

    def said(self) -> str:
        """One text for one way of asking."""
        if self.oracle_only:
            return "--oracle-only"
        return " | ".join(shlex.join(part) for part in (self.options, self.in_order, self.predict_in_order)).rstrip(
            " |"
        )


def judge(name: str, seed: int, folder: Path, asked: Asked) -> Row:
    """One robot from nothing to its row of results."""
    shutil.rmtree(folder, ignore_errors=True)
    robot = make(name, seed)
    truth = write(robot, folder, judged=True)
    row: Row = {"case": name, "seed": seed, "options": asked.said(), **truth["errors"]}
    if asked.oracle_only:
        return row
    discover = [*([] if "--seed" in asked.options else ["--seed", 0]), *asked.options]
    discover += asked.in_order if robot.case.in_order else ()
    paths = (folder / "table.csv", "--mechanism", folder / "robot.urdf", "--out", folder / "out")
    started = time.perf_counter()
    try:
        _program("discover", *paths, "--quiet", *discover)
        row["seconds"] = round(time.perf_counter() - started, 1)
        for where, names in (("", truth["fresh"]), ("beyond_", truth["beyond"])):
            later = asked.predict_in_order if robot.by_row else ()
            row |= _errors(names, where, folder, truth["errors"], later) if names else {}
    except RuntimeError as error:
        return {**row, "failed": str(error)}
    return {**row, **grade(json.loads((folder / "out" / "report.json").read_text())["effects"], truth)}


def _program(*arguments: object) -> None:
    """Run the product; RuntimeError with the last line it said where it fails or takes an hour."""
    try:
        run = subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"{arguments[0]}: no answer in {LONGEST_S} s") from None
    if run.returncode:
        raise RuntimeError(f"{arguments[0]}: {(run.stderr.strip().splitlines() or ['no message'])[-1]}")


def _predict(folder: Path, name: str, options: tuple[str, ...]) -> np.ndarray:
    """(N, 3) mm: the table `gpmodel predict` leaves, of what the instrument would read, its errors included."""
    out = folder / "predicted" / name
    model, poses = folder / "out" / "model.json", folder / f"{name}.csv"
    _program("predict", model, poses, "--as-measured", "--out", out, *options)
    return _positions(out if out.is_file() else min(out.glob("*.csv")))


def _positions(table: Path) -> np.ndarray:
    return pd.read_csv(table)[["x [mm]", "y [mm]", "z [mm]"]].to_numpy()


def _errors(names: list[str], where: str, folder: Path, errors: dict[str, float], options: tuple[str, ...]) -> Row:
    """Tabulate the product's predictions against true positions, measured positions and the geometric fit."""
    predicted = [_predict(folder, name, options) for name in names]
    off = {
        kind: np.vstack([p - _positions(folder / f"{n}_{kind}.csv") for p, n in zip(predicted, names, strict=True)])
        for kind in ("clean", "noisy")
    }
    row: Row = {}
    for kind, error in off.items():
        row[f"product_{where}{kind}_mm"] = rms_mm(error / 1e3)
        row[f"ratio_{where}{kind}"] = row[f"product_{where}{kind}_mm"] / errors[f"oracle_{where}{kind}_mm"]
    row[f"ratio_{where}standard"] = row[f"product_{where}noisy_mm"] / errors[f"geometric_{where}noisy_mm"]
    plain = [_positions(folder / f"{n}_standard.csv") - _positions(folder / f"{n}_noisy.csv") for n in names]
    return {**row, f"{where}worse": worse(off["noisy"], np.vstack(plain))}
