"""Measure the smallest random formula that is found, compared with a test that is given the formula.

From the root of the repository:
python -m experiments.random_laws.power --seeds 4 --robots 10 --results FILE.jsonl
The formula of each robot of random_laws is scaled to a multiple of the noise after a geometric fit (3-D RMS, 0 for no
effect). *told*: a likelihood-ratio test at 1 % is given formula, site and inner constants. *found*: a finding of
`discover` has every true input. A repeated command continues, and writes the table beside FILE.
"""

from __future__ import annotations

import tempfile
import time
from itertools import product
from pathlib import Path

import numpy as np
from scipy.stats import chi2

import gpmodel as gp
from experiments.methods.rows import Row, append, rounded, saved
from experiments.options import parsed
from experiments.random_laws.judge import graded, write
from experiments.random_laws.robot import Robot, factors_of, make
from gpmodel.api.table import read_table
from gpmodel.model.error_model import prepare

SIZES = (0.0, 0.1, 0.2, 0.4, 0.8, 1.6)
LEVEL = 0.01


def told_nats(robot: Robot, files: tuple[Path, Path, Path]) -> float:
    """Half the log likelihood ratio of the told law, its amount solved with the geometry: N/2 ln(E0 / E1), E the sum of
    squares of N coordinates."""
    assert robot.law
    assert robot.place
    law = gp.effect_at("told", robot.place.slot, robot.place.axis, robot.law, family="told")
    fits = [gp.calibrate(files[1], files[0], effects, holdout=0.0) for effects in ([], [law])]
    errors = [np.sum(np.square(found.residuals["error [mm]"])) for found in fits]
    return float(0.5 * robot.train.measured.size * np.log(errors[0] / errors[1]))


def judged(seed: int, factors: int | str, index: int, size: float, runs: int, folder: Path) -> Row:
    """One robot at one size."""
    noise = np.sqrt(3.0) * make(seed, factors, index).machine.case.noise_mm
    robot = make(seed, factors, index, size * noise)
    files = write(robot, folder)
    started = time.perf_counter()
    found = gp.discover(files[1], files[0], search=gp.Search(runs=runs))
    states = prepare(found.model.mechanism, read_table(files[0], found.model.mechanism)).states
    grade = graded(found.findings, robot, states)
    told = told_nats(robot, files) if size else 0.0
    return {
        "method": f"{runs} runs", "seed": seed, "factors": factors, "index": f"{index} at {size:g}", "size": size,
        "poses": len(robot.train.q), "told_nats": told, "told": bool(chi2.sf(2.0 * told, 1) < LEVEL), **grade,
        "found_any": bool(grade["found"]), "seconds": round(time.perf_counter() - started, 1),
    }  # fmt: skip


def table(rows: list[Row]) -> str:
    """Robots by size: told, inputs right, something found, something false."""
    lines = ["| inputs | size over noise | robots | told the law | found | anything | false |", "|" + "---|" * 7]
    for factors, size in sorted({(row["factors"], row["size"]) for row in rows}):
        some = [row for row in rows if (row["factors"], row["size"]) == (factors, size)]
        false = sum(bool(row["found_any"]) if not size else row["false"] > 0 for row in some)
        right = sum(row["inputs_right"] for row in some) if size else 0
        counts = (len(some), sum(row["told"] for row in some), right, sum(row["found_any"] for row in some), false)
        lines.append(f"| {factors} | {size:g} | " + " | ".join(map(str, counts)) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    settings = parsed(__doc__, factors="1,2", seeds="4", robots=10, runs=0, results=Path)
    rows = saved(settings.results)
    seeds = [int(word) for word in settings.seeds.split(",")]
    for index, seed, factor, size in product(range(settings.robots), seeds, factors_of(settings.factors), SIZES):
        identity = (f"{settings.runs} runs", seed, factor, f"{index} at {size:g}")
        if identity in rows:
            continue
        with tempfile.TemporaryDirectory() as folder:
            row = judged(seed, factor, index, size, settings.runs, Path(folder))
        rows[identity] = row
        append(row, settings.results)
        print(rounded({k: v for k, v in row.items() if k != "found"}), flush=True)
    text = table(list(rows.values()))
    settings.results.with_suffix(".md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
