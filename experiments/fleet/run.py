"""Calibrate twelve simulated machines of one type, one of them worn, and further machines with their prior.

From the root of the repository: python -m experiments.fleet.run [--seeds 1] [--further 3]
"""

import itertools
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

import gpmodel as gp
from experiments.blind.arms import ARMS
from experiments.blind.files import urdf
from experiments.fleet.machines import CASE, NAMED, SPREAD, Built, built, mean_amounts, table
from experiments.options import parsed
from gpmodel.files import to_json, write_text
from gpmodel.hierarchy.record import FleetPart

MACHINES, WORN = 12, 5
COUNTS = (8, 10, 12, 15, 20, 30, 45, 60)
FRESH = 300


def wrong(model: Any, machine: Built, rng: np.random.Generator) -> float:
    """RMS distance, mm, between predicted and true points of fresh poses."""
    sheet = machine.sheet(FRESH, rng)
    predicted = model.predict(table(sheet))[["x [mm]", "y [mm]", "z [mm]"]].to_numpy()
    return float(np.sqrt(np.mean(np.sum((predicted - 1e3 * sheet.clean) ** 2, axis=1))))


def further(arm: Any, machine: Built, fleet: FleetPart, rng: np.random.Generator) -> dict[str, list[float | None]]:
    """Errors of one further machine over the number of its poses, alone and with the prior; None where that is too
    few."""
    sheet = machine.sheet(max(COUNTS), rng)
    measured = table(sheet, sheet.measured)
    out: dict[str, list[float | None]] = {"alone": [], "with_prior": []}
    for count in COUNTS:
        for name, given in (("alone", {"effects": NAMED}), ("with_prior", {"fleet": fleet})):
            try:
                fit = gp.calibrate(arm, measured[:count], holdout=0.0, **given)
                out[name].append(wrong(fit.model, machine, np.random.default_rng(0)))
            except gp.InputError:
                out[name].append(None)
    return out


def as_good(alone: list[float], error: float) -> float | None:
    """Poses alone that reach an error, between those tried; None beyond the most tried."""
    for (n, before), (m, after) in itertools.pairwise(zip(COUNTS, alone, strict=True)):
        if after <= error:
            part = np.log(before / error) / np.log(before / after) if before > error else 0.0
            return float(n * (m / n) ** part)
    return None


def study(seed: int, count: int) -> dict[str, Any]:
    """One type: its machines calibrated together, then further ones."""
    machines = built(seed, worn=WORN)
    rng = np.random.default_rng([seed, 1])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.urdf"
        path.write_text(urdf(ARMS[CASE.arm]))
        arm = gp.load_mechanism(path)
    sheets = [m.sheet(CASE.poses, rng) for m in itertools.islice(machines, MACHINES)]
    fleet = gp.fleet(arm, {f"M{k}": table(s, s.measured) for k, s in enumerate(sheets)}, NAMED)
    effects = [p for p in fleet.record.effects if not p.constant]
    runs = [further(arm, machine, fleet.record, rng) for machine in itertools.islice(machines, count)]
    print(seed, fleet.verdict, flush=True)
    return {
        "verdict": fleet.verdict,
        "outliers": [[fleet.record.machines[k].serial, p.name] for k, p in fleet.record.outliers()],
        "off_mean_sigma": [(abs(p.mean) - a) / p.stderr for p, a in zip(effects, mean_amounts(seed), strict=True)],
        "spread_share": [p.spread / abs(p.mean) for p in effects],
        "spread_interval_holds": [p.low <= SPREAD * abs(p.mean) <= p.high for p in effects],
        "further": runs,
    }


def main() -> None:
    given = parsed(__doc__, seeds=1, further=3)
    studies = [study(seed, given.further) for seed in range(given.seeds)]
    every = [run for s in studies for run in s["further"]]
    mean = {
        name: [None if None in row else float(np.mean(row)) for row in zip(*(run[name] for run in every), strict=True)]
        for name in ("alone", "with_prior")
    }
    alone = [np.inf if e is None else e for e in mean["alone"]]
    results = {
        "command": f"python -m experiments.fleet.run --seeds {given.seeds} --further {given.further}",
        "counts": COUNTS, "mean_error_mm": mean,
        "poses_alone_as_good": [as_good(alone, e) for e in mean["with_prior"]], "types": studies,
    }  # fmt: skip
    write_text(Path(__file__).with_name("results.json"), to_json(results))
    print(to_json({k: results[k] for k in ("counts", "mean_error_mm", "poses_alone_as_good")}))


if __name__ == "__main__":
    main()
