"""Calibrate four sessions of a measured UR10 as a fleet.

Measures whether the sessions share their parameters, and the gain of the prior of three sessions for series D.
From the root of the repository, with the files of experiments/ur10_measured:
python -m experiments.fleet.measured --data FOLDER
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import gpmodel as gp
from experiments import measured
from experiments.options import parsed
from gpmodel.api.fleet import FleetResult
from gpmodel.arrays import IntArray
from gpmodel.errors import InputError
from gpmodel.files import to_json, write_text
from gpmodel.report.origin import versions
from gpmodel.table.dataset import Dataset

COLUMNS = Path(__file__).parents[1] / "ur10_measured" / "columns.toml"
SERIES = {"A": "Series_A/measurements_grid.csv", "D": "Series_D/measurements_iso_cubes.csv"}
EFFECTS = (
    *(f"joint_curve {joint}_joint" for joint in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_2")),
    "joint_compliance elbow_joint",
)
"""Effects known from series A: error curves of the joints, and a compliant elbow."""
COUNTS = (20, 40)


def part(dataset: Dataset, rows: IntArray, name: str) -> Dataset:
    """Some rows as the table of a session."""
    return replace(dataset.subset(np.sort(rows)), source=name)


def later_errors(few: Dataset, later: Dataset, three: FleetResult) -> dict[str, float | None]:
    """Mean 3-D error, mm, on poses `later` of a fit to a few, alone and with the prior of three sessions; null where
    they do not determine it."""
    out: dict[str, float | None] = {}
    for name, model in (
        ("alone", lambda: gp.calibrate("ur10", few, EFFECTS, holdout=0.0).model),
        ("with_prior", lambda: gp.calibrate("ur10", few, fleet=three.record, holdout=0.0).model),
    ):
        try:
            out[name] = float(np.mean(model().misses(later)))
        except InputError:
            out[name] = None
    return out


def main() -> None:
    given = parsed(__doc__, data=Path, poses=100)
    if not all((given.data / file).is_file() for file in SERIES.values()):
        sys.exit(f"{given.data} has not {' and '.join(SERIES.values())}: nothing measured here")
    data = {name: measured.load(given.data / file, COLUMNS, "ur10").dataset for name, file in SERIES.items()}
    rng = np.random.default_rng(0)
    thirds = np.array_split(np.arange(len(data["A"])), 3)
    sessions = {
        f"A{k}": part(data["A"], rng.permutation(rows)[: given.poses], f"A{k}") for k, rows in enumerate(thirds, 1)
    }
    order = rng.permutation(len(data["D"]))
    seen, later = order[: len(order) // 2], part(data["D"], order[len(order) // 2 :], "D")
    every = gp.fleet("ur10", sessions | {"D": part(data["D"], seen[: given.poses], "D")}, EFFECTS)
    three = gp.fleet("ur10", sessions, EFFECTS, holdout=0.0)
    curve = [{"poses": n, **later_errors(part(data["D"], seen[:n], "D"), later, three)} for n in COUNTS]
    results = {
        "command": f"python -m experiments.fleet.measured --data FOLDER --poses {given.poses}",
        "four_sessions": every.verdict,
        "outliers": [[every.record.machines[k].serial, p.name, p.chances[k]] for k, p in every.record.outliers()],
        "heldout_rms_mm": [
            {"session": m.serial, "alone": m.own_mm, "together": m.fleet_mm} for m in every.record.machines
        ],
        "spread_of_prior": {p.name: [p.spread, p.low, p.high] for p in every.record.blocks},
        "series_D_mean_error_mm": curve,
        "versions": versions(),
    }
    write_text(Path(__file__).with_name("results_measured.json"), to_json(results))
    print(to_json(results))


if __name__ == "__main__":
    main()
