"""Search rigs of 60 poses with the tooling ball on or off the yaw axis.

From the root of the repository: python -m experiments.spherical_joint.rigs [--rigs 10] [--covered 200] [--out FOLDER]

All poses select effects, and 5-fold cross-validation confirms them, as in `gpmodel discover` with few poses. `told`
is the number of rigs on which a fit with the true form of the effect passes the acceptance rule.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.options import parsed
from experiments.spherical_joint.rig import Rig
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.discovery.folds import discover_by_folds
from gpmodel.discovery.loop import discover
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import residual_of
from gpmodel.executor import Forks
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.model.error_model import ErrorModel, Poses, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
from gpmodel.report.origin import versions
from gpmodel.selection.offers import Offering, of_offers
from gpmodel.selection.select import select
from gpmodel.table.dataset import Dataset
from joints import spherical_joint

HERE = Path(__file__).parent
JOINT = spherical_joint()
POSES, FOLDS = 60, 5


@dataclass(frozen=True)
class Kind:
    """A disturbance (N,), m, along the lever, of angles (N, 3) and temperature (N,), degC. reads: the input that a
    finding has to read, empty of nothing. name: the catalogue's for it."""

    shape: Callable[[Array, Array], Array]
    reads: str = ""
    name: str = ""


KINDS = {
    "nothing": Kind(lambda q, t: 0.0 * t),
    "lobes": Kind(
        lambda q, t: 12e-6 * np.cos(3 * q[:, 1]), "J2", "out-of-round ball, 3 lobes over J2, lift along the lever"
    ),
    "sin2J1": Kind(
        lambda q, t: 8e-6 * np.sin(2 * q[:, 0]), "J1", "out-of-round ball, 2 lobes over J1, lift along the lever"
    ),
    "growth": Kind(lambda q, t: 1.2e-6 * (t - 20.0), "temperature", "thermal growth of the arm (temperature)"),
}


def needed(train: Poses, told: Candidate) -> float:
    """Standard deviations at which a candidate alone saves `Criteria.minimum_nats` at these poses.

    With f degrees of freedom, k unknowns and M numbers measured, f/2 ln(1 + z²/(f - k)) = nats + cost + k/2 ln M.
    """
    criteria, count = Criteria(), len(told.effects)
    residual = residual_of(calibrate(ErrorModel(JOINT, geometric_effects(JOINT)), train), train, criteria, 0)
    nats = criteria.minimum_nats + told.cost + 0.5 * count * np.log(residual.measured)
    return float(np.sqrt((residual.freedom - count) * np.expm1(2.0 * nats / residual.freedom)))


def rig_of(number: int, kind: str, on_axis: bool) -> tuple[Rig, Dataset]:
    """A rig and its table of 60 poses. on_axis: the tooling ball sits on the yaw axis, not where described."""
    true = replace(JOINT, tooling_ball=(0.0, 0.0, 0.04521)) if on_axis else JOINT
    rng = np.random.default_rng([9, number, len(kind)])
    rig = Rig(
        true, rotation_deg=(4, -0.74, -1.72), parameters={15: -25.4e-6}, noise=2e-6,
        angle_noise=float(np.radians(0.87)), reach=tuple(np.radians([60, 60, 150])),
    )  # fmt: skip
    q, warm = rig.poses(POSES, rng), rng.uniform(18.0, 26.0, POSES)
    lever = np.divide(true.tooling_ball, np.linalg.norm(true.tooling_ball))
    return rig, rig.measure(
        q, rng, {"temperature": ("degC", warm)},
        lambda q, _: {25 + k: along * KINDS[kind].shape(q, warm) for k, along in enumerate(lever)},
    )  # fmt: skip


def told(kind: str, poses: Poses) -> dict[str, Any]:
    """Standard deviations of the effect as a fit to these poses told its shape has it, and those needed alone."""
    if not KINDS[kind].name:
        return {}
    named = next(c for c in catalogue.candidates(JOINT, poses.states) if c.name == KINDS[kind].name)
    fit = calibrate(ErrorModel(JOINT, (*geometric_effects(JOINT), *named.effects)), poses)
    own = slice(-len(named.effects), None)
    sigmas, limit = float(np.abs(fit.theta[own] / fit.stderr[own]).max()), needed(poses, named)
    return {"told_sigmas": round(sigmas, 1), "needed_sigmas": round(limit, 1), "told": sigmas > limit}


def found_on(number: int, kind: str, on_axis: bool) -> dict[str, Any]:
    """Return the findings on one rig, and the residual of the fit relative to the standard model's noise.

    true_name: whether the finding has it, or lists it among what it could as well be. refused: what was chosen and
    failed a test.
    """
    poses = prepare(JOINT, rig_of(number, kind, on_axis)[1])
    run = partial(discover, JOINT, search=Search(runs=0, workers=1))
    found = run(poses, np.arange(POSES), np.zeros(0, dtype=np.int64))
    if found.findings:
        found = discover_by_folds(run, [run], poses, FOLDS, Criteria(), Forks())
    standard = found.steps[1].calibration
    chosen = select(standard, poses, Offering((of_offers(catalogue.catalogue),)))
    reads, name = KINDS[kind].reads, KINDS[kind].name
    read = [{i for e in f.candidate.effects for i in e.inputs} for f in found.findings]
    rivals = [f.hypothesis.causes.names if f.hypothesis.causes else () for f in found.findings]
    named = [f.candidate.name for f in found.findings]
    return {
        "number": number,
        "named": named,
        "rivals": rivals,
        "refused": {h.candidate.name: h.why for h in found.rounds[0].hypotheses if not h.accepted},
        "right": any(r == {reads} for r in read) if reads else not found.findings,
        **({"true name": any(name in (n, *others) for n, others in zip(named, rivals, strict=True))} if name else {}),
        "shipped": found.confirmation is None or found.confirmation.passed,
        "refit": round(float(chosen.state.sigma / standard.sigma), 3),
        "heldout_rms_um": [
            round(1e6 * float(np.sqrt(np.mean(s.heldout_error**2))), 2) for s in found.steps if found.findings
        ],
        **told(kind, poses),
    }


def misses(number: int, on_axis: bool) -> dict[str, float]:
    """By how many of its stated standard deviations every number of the placement of an innocent rig is off."""
    rig, data = rig_of(number, "nothing", on_axis)
    fit = calibrate(ErrorModel(JOINT, geometric_effects(JOINT)), prepare(JOINT, data))
    tool = np.subtract(rig.joint.tooling_ball, JOINT.tooling_ball)
    frame = rig.registration
    truth = [*frame[:3, 3], *se3.rotation_vector(frame[:3, :3]), *tool]
    return {p.name: float((p.value - t) / p.stderr) for p, t in zip(fit.placement_numbers, truth, strict=True)}


def coverage(count: int, on_axis: bool) -> dict[str, Any]:
    """Share of rigs on which each number of the placement is within 1 and 1.96 of its standard deviations."""
    off = [misses(number, on_axis) for number in range(count)]
    size = {name: np.abs([rig[name] for rig in off]) for name in off[0]}
    within = {name: {str(k): round(float(np.mean(v < k)), 3) for k in (1.0, 1.96)} for name, v in size.items()}
    every = np.concatenate(list(size.values()))
    return {"rigs": count, "95 % of all": round(float(np.mean(every < 1.96)), 3), "within": within}


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = parsed(__doc__, arguments, rigs=10, covered=200, out=HERE)
    results: dict[str, Any] = {
        "command": f"python -m experiments.spherical_joint.rigs --rigs {chosen.rigs} --covered {chosen.covered}",
        "versions": versions(),
    }
    for ball, on_axis in (("ball on the yaw axis", True), ("ball off the axis", False)):
        kinds: dict[str, Any] = {}
        for kind in KINDS:
            rigs = [found_on(number, kind, on_axis) for number in range(chosen.rigs)]
            largest = max(rig["refit"] for rig in rigs)
            counts = {
                key: sum(rig[key] for rig in rigs)
                for key in ("right", "true name", "shipped", "told")
                if key in rigs[0]
            }
            kinds[kind] = {**counts, "of": len(rigs), "largest refit": largest, "rigs": rigs}
            print(ball, kind, counts, largest, [rig["named"] for rig in rigs], flush=True)
        results[ball] = {"found": kinds, "coverage": coverage(chosen.covered, on_axis)}
        print(ball, results[ball]["coverage"], flush=True)
    (chosen.out / "rigs.json").write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return results


if __name__ == "__main__":
    main()
