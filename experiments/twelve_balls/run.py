"""Search machines of twelve ball joints of which one is out of round.

From the root of the repository:
python -m experiments.twelve_balls.run [--kind hexapod] [--machines 20] [--innocent 20] [--out FOLDER]

The search uses the catalogue alone, and all poses select. `told`: size of the lobes in standard errors, in a fit with
the true form and site; `needed`: size at which the lobes alone pass the acceptance rule.
"""

import io
import json
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import gpmodel as gp
from experiments.options import parsed
from experiments.twelve_balls.simulator import BALLS, LOBES, MACHINES, Fault, table
from gpmodel.api.calibrate import checked_poses
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.families import catalogue
from gpmodel.mechanism.protocol import Mechanism, balls_of
from gpmodel.model.error_model import ErrorModel, Poses
from gpmodel.model.sites import geometric_effects
from gpmodel.report.origin import versions

HERE = Path(__file__).parent
POSES = {"hexapod": 120, "tau": 300}


def measured(kind: str, text: str) -> tuple[Mechanism, Poses]:
    """The machine, and the poses of a table."""
    machine = gp.load_mechanism(kind if kind == "tau" else str(MACHINES[kind][0]))
    data = gp.read_table(pd.read_csv(io.StringIO(text), dtype=str), machine)
    return checked_poses(machine, data, geometric_effects(machine))


def told(machine: Mechanism, poses: Poses, fault: Fault) -> dict[str, float]:
    """Standard deviations of the lobes in a fit told of them, and those needed alone: of k unknowns over M numbers
    with f degrees of freedom, f/2 ln(1 + z²/(f - k)) = nats + cost + k/2 ln M."""
    name = f"out-of-round ball, {LOBES} lobes over {fault.angle}, lift along L{fault.ball // 2 + 1}"
    lobes = next(c for c in catalogue.candidates(machine, poses.states) if c.name == name)
    fit = calibrate(ErrorModel(machine, (*geometric_effects(machine), *lobes.effects)), poses)
    own = slice(-2, None)
    covariance = fit.covariance.values[own, own]
    sigmas = float(np.sqrt(fit.theta[own] @ np.linalg.solve(covariance, fit.theta[own])))
    plain = calibrate(ErrorModel(machine, geometric_effects(machine)), poses)
    residual = residual_of(plain, poses, Criteria(), 0)
    nats = Criteria().minimum_nats + lobes.cost + np.log(residual.measured)
    needed = float(np.sqrt((residual.freedom - 2) * np.expm1(2.0 * nats / residual.freedom)))
    return {"told_sigmas": round(sigmas, 1), "needed_sigmas": round(needed, 1)}


def one_machine(kind: str, seed: int, planted: bool) -> dict[str, Any]:
    """Return the findings on one machine, and the balls at which they act."""
    text, fault = table(kind, seed, planted, POSES[kind])
    machine, poses = measured(kind, text)
    nothing = np.zeros(0, dtype=np.int64)
    found = discover(machine, poses, np.arange(len(poses)), nothing, search=Search(runs=0, workers=1), seed=seed)
    of_angle = {angle: ball.name for ball in balls_of(machine) for angle in ball.angles}
    named = [{of_angle.get(i, i) for e in f.candidate.effects for i in e.inputs} for f in found.findings]
    out = {"seed": seed, "named": [f.candidate.name for f in found.findings]}
    if not planted:
        return out | {"right": not found.findings}
    close = [f.hypothesis.causes.names if f.hypothesis.causes else () for f in found.findings]
    return out | {
        "truth": f"{LOBES} lobes over {fault.angle}",
        "right": named == [{BALLS[fault.ball]}],
        "lobes": any(f"{LOBES} lobes over {fault.angle}" in n for n in (*out["named"], *chain(*close))),
        "rivals": close,
        "um": [round(1e6 * float(np.linalg.norm(found.final.theta[-2:])), 2)] if found.findings else [],
        **told(machine, poses, fault),
    }


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = parsed(__doc__, arguments, machines=20, innocent=20, kind=tuple(MACHINES), out=HERE)
    kind = chosen.kind
    bad = [one_machine(kind, seed, True) for seed in range(chosen.machines)]
    good = [one_machine(kind, seed, False) for seed in range(chosen.innocent)]
    sizes = f"--machines {chosen.machines} --innocent {chosen.innocent}"
    results: dict[str, Any] = {
        "command": f"python -m experiments.twelve_balls.run --kind {kind} {sizes}",
        "versions": versions(),
        "poses": POSES[kind],
        "the bad ball is named, and nothing else": f"{sum(m['right'] for m in bad)} of {len(bad)}",
        "its lobes are named or among the rivals": f"{sum(m['lobes'] for m in bad)} of {len(bad)}",
        "told of them a fit passes": f"{sum(m['told_sigmas'] > m['needed_sigmas'] for m in bad)} of {len(bad)}",
        "silent where all are good": f"{sum(m['right'] for m in good)} of {len(good)}",
        "machines": bad,
        "innocent": good,
    }
    print({k: v for k, v in results.items() if isinstance(v, str)}, flush=True)
    text = json.dumps(results, indent=1, ensure_ascii=False)
    (chosen.out / f"{kind}.json").write_text(f"{text}\n", encoding="utf-8")
    return results


if __name__ == "__main__":
    main()
