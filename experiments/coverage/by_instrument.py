"""Measure the coverage of ± for every instrument of `experiments.instruments`.

From the root of the repository: python -m experiments.coverage.by_instrument --robots 20 --out FILE
*effect*: (|value| - true amount) / ±. *geometry*: (value - value of a fit to exact readings) / ±, for tracker and
cameras, whose noise is in the readings alone. A repeated command continues.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import gpmodel as gp
from experiments.instruments.judge import POSES, table
from experiments.instruments.measuring import session
from experiments.instruments.robots import description, machine
from experiments.options import parsed
from gpmodel.numerics.interval import coverage_factor

NAMED = {
    "compliance": "joint compliance, J{}", "harmonic": "eccentricity, 1 per turn, J{}",
    "gravity_backlash": "backlash by load, J{}",
}  # fmt: skip
Row = dict[str, Any]


def asked(kind: str, seed: int) -> Row:
    """One machine with its effect declared."""
    arms = 2 if kind == "two arms" else 1
    robots, rng = machine(seed, True, arms), np.random.default_rng([seed, arms, 19])
    made = session(kind, robots, POSES[kind], rng)
    name = NAMED[robots[0].kind].format(robots[0].joint)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "robot.urdf"
        file.write_text(description(robots))
        loaded = gp.load_mechanism(str(file), frame="link_6,right_6" if arms > 1 else "link_6")
        said = gp.calibrate(loaded, gp.read_table(table(made, loaded), loaded, **made.described), [name])
        (effect,), fit = said.record.effects, said.fit[0]
        z = {"effect": [(abs(effect.value) - abs(robots[0].amount)) / effect.stderr]}
        if kind == "tracker" or "camera" in kind:
            readings = made.read(robots[0].last(made.q), robots[0].tools(made.q), made.own)
            exact = replace(made, noisy=readings, columns=dict(zip(made.columns, 0.03 * readings.T, strict=False)))
            other = gp.calibrate(loaded, gp.read_table(table(exact, loaded), loaded, **made.described), [name]).fit[0]
            own = {e.name for e in said.calibrated.named}
            both = fit.free & other.free & np.array([e.name not in own for e in fit.model.effects])
            z["geometry"] = ((fit.theta - other.theta)[both] / fit.stderr[both]).tolist()
    return {
        "kind": kind, "seed": seed, "effect": name, "status": fit.status,
        "k": round(coverage_factor(said.record.freedom or np.inf), 3),
        "z": {key: [round(float(v), 2) for v in values] for key, values in z.items()},
    }  # fmt: skip


def summary(rows: list[Row]) -> dict[str, Any]:
    """Shares within k σ by instrument and over all."""
    out = {}
    for kind in ("all", *POSES):
        own = [row for row in rows if kind in ("all", row["kind"])]
        held = {
            what: [abs(v) <= row["k"] for row in own for v in row["z"].get(what, [])] for what in ("effect", "geometry")
        }
        out[kind] = {"robots": len(own)} | {w: [round(float(np.mean(h)), 4), len(h)] for w, h in held.items() if h}
    return out


def main() -> None:
    given = parsed(__doc__, robots=20, out=Path)
    rows: list[Row] = json.loads(given.out.read_text())["robots"] if given.out.exists() else []
    done = {(row["kind"], row["seed"]) for row in rows}
    for seed in range(100, 100 + given.robots):
        for kind in POSES:
            if (kind, seed) not in done:
                rows.append(asked(kind, seed))
                given.out.write_text(json.dumps({"summary": summary(rows), "robots": rows}, indent=1) + "\n")
    print(json.dumps(summary(rows), indent=1))


if __name__ == "__main__":
    main()
