"""Compare linear propagation of errors with a Monte Carlo over the readings.

From the root of the repository: python -m experiments.coverage.monte_carlo --machines 0,1,11 --worlds 60 --out FILE
Every world measures the fitted model anew, with its own noise, and fits it again. Source: JCGM 101 (2008), 8: linear
propagation is confirmed where both agree.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.coverage.truth import hall, machine_of
from experiments.options import command, parsed
from gpmodel.api.calibrate import calibrate as calibrate_table
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.model.error_model import observe


def compared(number: int, worlds: int) -> dict[str, Any]:
    """Return quantiles, over the worlds, of the error of a machine's numbers in σ, and the largest shift of a mean."""
    stratum, case, name = machine_of(number)
    with tempfile.TemporaryDirectory() as folder:
        here = hall(case, number, folder)
    result = calibrate_table(here.mechanism, here.tables[0], [name] if name else [])
    fit, poses, rng = result.calibrated.final, result.calibrated.poses, np.random.default_rng(number)
    tip = observe(fit.model, poses, fit.theta, fit.placement).tip[:, :3, 3]
    drawn = []
    for _ in range(worlds):
        data = replace(poses.dataset, position=tip + fit.sigma * rng.normal(size=tip.shape))
        again = calibrate(
            fit.model, replace(poses, dataset=data), condition_limit=fit.condition_limit, start=fit, robust=False
        )
        drawn.append([*again.theta[fit.free], *(p.value for p in again.placement_numbers)])
    said = np.array([*fit.stderr[fit.free], *(p.stderr for p in fit.placement_numbers)])
    value = np.array([*fit.theta[fit.free], *(p.value for p in fit.placement_numbers)])
    ratio = np.std(drawn, axis=0, ddof=1) / said
    shift = (np.mean(drawn, axis=0) - value) / said
    return {
        "machine": number, "stratum": stratum, "arm": case.arm, "numbers": len(said),
        "ratio": [round(float(v), 3) for v in np.quantile(ratio, (0.05, 0.5, 0.95))],
        "shift": round(float(np.abs(shift).max()), 3),
    }  # fmt: skip


def main() -> None:
    settings = parsed(__doc__, machines="0,1,11", worlds=60, out=Path)
    rows = [compared(int(number), settings.worlds) for number in settings.machines.split(",")]
    settings.out.write_text(json.dumps({"command": command(), "machines": rows}, indent=1) + "\n")
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
