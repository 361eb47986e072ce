"""Weak effects on the joint at 60 poses and 2 µm noise: on how many rigs does the loop name them, and could any rule?

From the root of the repository: python -m experiments.spherical_joint.weak [--rigs 8] [--out FOLDER]
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from experiments.spherical_joint.rig import Rig
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.evolution.linear import Linear
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.report.origin import versions
from gpmodel.table.bundles import hold_out
from joints import spherical_joint

HERE = Path(__file__).parent
JOINT = spherical_joint()
POSES, HELD_OUT = {"60 poses, 18 of them held out": 60, "60 poses, and 26 more held out": 86}, 0.3
LOBE, GROWTH, NOISE = 8e-6, 0.4e-6, 2e-6
HALL = (15.0, 30.0)
"""degC, of a hall over a day."""

OFFSETS = {14: -2.54e-6, 15: -25.4e-6, 19: 20.32e-6}
"""The three offsets of Table 3.5, m, by thesis index."""
SEARCH = Search(runs=1, strategies=(Linear(),), workers=1, population=512, generations=15, climb=1)
ALONG = GROWTH * JOINT.tooling_ball[2] / float(np.dot(JOINT.tooling_ball, JOINT.tooling_ball))
"""1/K, growth along z as the share of it along the lever, relative to the lever: what the catalogue's growth is."""

Case = tuple[int, str, frozenset[str], float]
CASES: dict[str, Case] = {
    "lift of the ball, 8 µm sin 2J1": (3, "out-of-round ball, 2 lobes over J1, lift along z", frozenset({"J1"}), LOBE),
    "pitch axis along z, 8 µm sin 2J1": (15, "axis run-out, 2 per turn, J1 Tz", frozenset({"J1"}), LOBE),
    "growth of the shaft, 0.4 µm/K": (27, "thermal growth of the arm (temperature)", frozenset({"temperature"}), ALONG),
    "nothing": (3, "", frozenset(), 0.0),
}
"""Thesis index of what is disturbed, the catalogue's name for it, the inputs that a finding has to read, its size."""


def disturbed(case: str, q: Array, warm: Array) -> dict[int, Array]:
    """Return the disturbance (N,) of the parameter of a case at every pose, m."""
    index, name, *_ = CASES[case]
    shape = GROWTH * (warm - 22.0) if index == 27 else LOBE * np.sin(2 * q[:, 0])
    return {index: shape if name else 0.0 * shape}


def needed(train: Poses, told: Candidate) -> float:
    """Standard deviations at which a candidate alone saves `Criteria.minimum_nats` at these poses.

    With f degrees of freedom, k unknowns and M numbers measured, f/2 ln(1 + z²/(f - k)) = nats + cost + k/2 ln M.
    """
    criteria, count = Criteria(), len(told.effects)
    residual = residual_of(calibrate(ErrorModel(JOINT, geometric_effects(JOINT)), train), train, criteria, 0)
    nats = criteria.minimum_nats + told.cost + 0.5 * count * np.log(residual.measured)
    return float(np.sqrt((residual.freedom - count) * np.expm1(2.0 * nats / residual.freedom)))


def strength(case: str, train: Poses) -> tuple[Calibration, dict[str, float]]:
    """The fit to the training poses told what is there, and how far that stands out of the noise.

    sigmas: as fitted. expected: of its true size, by the Cramér-Rao bound with the true noise. needed: to be accepted.
    """
    _, name, _, size = CASES[case]
    told = [c for c in catalogue.candidates(JOINT, train.states) if c.name == name]
    fit = calibrate(ErrorModel(JOINT, (*geometric_effects(JOINT), *(e for c in told for e in c.effects))), train)
    if not told:
        return fit, {}
    own = slice(-len(told[0].effects), None)
    found, bound = np.abs(fit.theta[own] / fit.stderr[own]).max(), fit.stderr[own][0] * NOISE / fit.sigma
    values = {"sigmas": float(found), "expected": float(size / bound), "needed": needed(train, told[0])}
    return fit, {key: round(value, 1) for key, value in values.items()}


def one_rig(case: str, count: int, seed: int) -> dict[str, Any]:
    """Return the findings, and the held-out rms [µm] of the standard model, of the found model and of one with the
    effect given.
    """
    rng = np.random.default_rng([325, seed])
    rig = Rig(JOINT, parameters=OFFSETS, noise=NOISE, reach=(1.5, 1.2, 1.5))
    q, warm = rig.poses(count, rng), rng.uniform(*HALL, count)
    data = rig.measure(q, rng, {"temperature": ("degC", warm)}, lambda q, extras: disturbed(case, q, warm))
    poses, (train, heldout) = prepare(JOINT, data), hold_out(data, HELD_OUT, np.random.default_rng(seed))
    found = discover(JOINT, poses, train, heldout, search=SEARCH, seed=seed)
    _, name, inputs, _ = CASES[case]
    told, stands_out = strength(case, poses.subset(train))
    errors = (found.steps[1].heldout_error, found.steps[-1].heldout_error, errors_on(told, poses.subset(heldout)))
    named = [f.candidate.name for f in found.findings]
    read = [frozenset(i for e in f.candidate.effects for i in e.inputs) for f in found.findings]
    return {
        "seed": seed,
        "named": named,
        "right": any(r == inputs for r in read) if name else not named,
        "only": all(r == inputs for r in read),
        **stands_out,
        "heldout_rms_um": [round(1e6 * float(np.sqrt(np.mean(e**2))), 2) for e in errors],
    }


def by_the_bound(rigs: list[dict[str, Any]]) -> float:
    """On how many rigs Gaussian noise lets an effect of the expected strength pass the bar."""
    return round(float(sum(norm.cdf(rig["expected"] - rig["needed"]) for rig in rigs)), 1)


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    parser = argparse.ArgumentParser(prog="python -m experiments.spherical_joint.weak", description=__doc__)
    parser.add_argument("--rigs", type=int, default=8)
    parser.add_argument("--out", type=Path, default=HERE)
    chosen = parser.parse_args(arguments)
    cases: dict[str, Any] = {}
    results: dict[str, Any] = {}
    for said, count in POSES.items():
        for case in CASES:
            rigs = [one_rig(case, count, seed) for seed in range(chosen.rigs)]
            right, only = (sum(rig[key] for rig in rigs) for key in ("right", "only"))
            found: dict[str, Any] = {"found": f"{right} of {len(rigs)}", "nothing else": f"{only} of {len(rigs)}"}
            found |= {"by the bound": by_the_bound(rigs)} if CASES[case][1] else {}
            print(said, case, found, [r["named"] for r in rigs], flush=True)
            cases[f"{said}: {case}"] = {**found, "rigs": rigs}
            results = {"command": f"{parser.prog} --rigs {chosen.rigs}", "versions": versions(), "cases": cases}
            text = json.dumps(results, indent=1, ensure_ascii=False)
            (chosen.out / "weak.json").write_text(f"{text}\n", encoding="utf-8")
    return results


if __name__ == "__main__":
    main()
