"""Weak effects on the joint at 60 poses and 2 µm noise: on how many rigs does the loop name them?

From the root of the repository: python -m experiments.spherical_joint.weak [--rigs 8] [--out FOLDER]
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.evolution.linear import Linear
from gpmodel.families import catalogue
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.geometric import geometric_effects
from gpmodel.report.origin import versions
from gpmodel.table.split import hold_out
from joints import spherical_joint
from joints.rig import Rig

HERE = Path(__file__).parent
JOINT = spherical_joint()
POSES, HELD_OUT = {"60 poses, 18 of them held out": 60, "60 poses, and 26 more held out": 86}, 0.3
LOBE, GROWTH, NOISE = 8e-6, 0.4e-6, 2e-6
HALL = (15.0, 30.0)
"""degC, of a hall over a day."""

OFFSETS = {14: -2.54e-6, 15: -25.4e-6, 19: 20.32e-6}
"""The three offsets of Table 3.5, m, by thesis index."""
SEARCH = Search(runs=1, strategies=(Linear(),), workers=1, population=512, generations=15, climb=1)
Case = tuple[int, str, frozenset[str]]
CASES: dict[str, Case] = {
    "lift of the ball, 8 µm sin 2J1": (3, "out-of-round ball, 2 lobes over J1, lift along z", frozenset({"J1"})),
    "pitch axis along z, 8 µm sin 2J1": (15, "axis run-out, 2 per turn, J1 Tz", frozenset({"J1"})),
    "growth of the shaft, 0.4 µm/K": (27, "thermal growth of the arm (temperature)", frozenset({"temperature"})),
    "nothing": (3, "", frozenset()),
}
"""Thesis index of what is disturbed, the catalogue's name for it, the inputs that a finding has to read."""


def disturbed(case: str, q: Array, warm: Array) -> dict[int, Array]:
    """What is added (N,) to the parameter of a case at every pose, m."""
    index, name, _ = CASES[case]
    shape = GROWTH * (warm - 22.0) if index == 27 else LOBE * np.sin(2 * q[:, 0])
    return {index: shape if name else 0.0 * shape}


def one_rig(case: str, count: int, seed: int) -> dict[str, Any]:
    """What the loop names, and the held-out rms [µm] of the standard model, of its own and of one told the effect."""
    rng = np.random.default_rng([325, seed])
    rig = Rig(JOINT, parameters=OFFSETS, noise=NOISE, reach=(1.5, 1.2, 1.5))
    q, warm = rig.poses(count, rng), rng.uniform(*HALL, count)
    data = rig.measure(q, rng, {"temperature": ("degC", warm)}, lambda q, extras: disturbed(case, q, warm))
    poses, (train, heldout) = prepare(JOINT, data), hold_out(data, HELD_OUT, np.random.default_rng(seed))
    found = discover(JOINT, poses, train, heldout, search=SEARCH, seed=seed)
    _, name, inputs = CASES[case]
    told = [e for c in catalogue.candidates(JOINT, poses.states) if c.name == name for e in c.effects]
    oracle = calibrate(ErrorModel(JOINT, (*geometric_effects(JOINT), *told)), poses)
    strength = [
        abs(t) / s for e, t, s in zip(oracle.model.effects, oracle.theta, oracle.stderr, strict=True) if e in told
    ]
    told_fit = calibrate(oracle.model, poses.subset(train))
    errors = (found.steps[1].heldout_error, found.steps[-1].heldout_error, errors_on(told_fit, poses.subset(heldout)))
    named = [f.candidate.name for f in found.findings]
    read = [frozenset(i for e in f.candidate.effects for i in e.inputs) for f in found.findings]
    return {
        "seed": seed,
        "named": named,
        "right": any(r == inputs for r in read) if name else not named,
        "only": all(r == inputs for r in read),
        "sigmas": round(float(np.abs(strength).max()), 1) if told else None,
        "heldout_rms_um": [round(1e6 * float(np.sqrt(np.mean(e**2))), 2) for e in errors],
    }


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    parser = argparse.ArgumentParser(prog="python -m experiments.spherical_joint.weak", description=__doc__)
    parser.add_argument("--rigs", type=int, default=6)
    parser.add_argument("--out", type=Path, default=HERE)
    chosen = parser.parse_args(arguments)
    cases: dict[str, Any] = {}
    results: dict[str, Any] = {}
    for said, count in POSES.items():
        for case in CASES:
            rigs = [one_rig(case, count, seed) for seed in range(chosen.rigs)]
            right, only = (sum(rig[key] for rig in rigs) for key in ("right", "only"))
            found = {"found": f"{right} of {len(rigs)}", "nothing else": f"{only} of {len(rigs)}"}
            print(said, case, found, [r["named"] for r in rigs], flush=True)
            cases[f"{said}: {case}"] = {**found, "rigs": rigs}
            results = {"command": f"{parser.prog} --rigs {chosen.rigs}", "versions": versions(), "cases": cases}
            text = json.dumps(results, indent=1, ensure_ascii=False)
            (chosen.out / "weak.json").write_text(f"{text}\n", encoding="utf-8")
    return results


if __name__ == "__main__":
    main()
