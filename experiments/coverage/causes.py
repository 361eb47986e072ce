"""Measure the coverage of intervals over all causes of a finding, and of the stated fit alone.

From the root of the repository: python -m experiments.coverage.causes --arms 100 --rigs 20 --out FILE
Arms have an undeclared effect about as large as the noise, rigs a ball with lobes on its axis or off the axis. An arm
counts if its findings have more than one cause, or if nothing is found. A repeated command continues.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.blind.case import Case, effect
from experiments.coverage.truth import exact, hall, poses_at
from experiments.options import parsed
from experiments.spherical_joint.rigs import JOINT, rig_of
from experiments.tables import run_jobs
from gpmodel.api.discover import discover
from gpmodel.application.over_causes import over_causes
from gpmodel.application.predict import coordinate_deviations
from gpmodel.calibration.result import Calibration, placement_numbers, problem_at
from gpmodel.discovery.loop import discover as run_loop
from gpmodel.discovery.search import Search
from gpmodel.discovery.state import Discovery
from gpmodel.families import catalogue
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.numerics import se3
from gpmodel.numerics.interval import coverage_factor

Row = dict[str, Any]
ARMS = ("ur_like", "irb_like", "puma_like", "staubli_like", "kuka_like", "cobot_ten", "welder")
KINDS = {
    "compliance": (lambda j: {"joint": j}, "joint compliance, J{}", (2, 3, 5)),
    "gear_ratio": (lambda j: {"joint": j}, "gear ratio, J{}", (2, 3, 5)),
    "harmonic": (lambda j: {"joint": j, "per_turn": 1}, "eccentricity, 1 per turn, J{}", (2, 3, 5)),
    "coupling": (lambda j: {"source": j - 1, "joint": j}, "coupling, J4 to J{}", (5,)),
    "base_compliance": (lambda j: {}, "base compliance", (0,)),
}
"""Settings of the simulator, the catalogue's name, and joints."""
QUICK = Search(runs=0, workers=1)


def arm_of(number: int) -> tuple[Case, str]:
    """A case, and the catalogue's name of its effect."""
    rng = np.random.default_rng([number, 77])
    kind = str(rng.choice(list(KINDS)))
    settings, name, joints = KINDS[kind]
    joint, poses = int(rng.choice(joints)), int(rng.integers(45, 91))
    undeclared = effect(kind, float(rng.uniform(0.03, 0.12)), **settings(joint))
    arm = str(rng.choice(ARMS))
    return Case(f"{arm}, {kind}", arm, poses=poses, noise_mm=0.04, effects=(undeclared,)), name.format(joint)


def arm(number: int) -> Row:
    """One arm: what is found, and z of all that is printed, over the causes and by the stated fit."""
    case, name = arm_of(number)
    with tempfile.TemporaryDirectory() as folder:
        here = hall(case, number, folder)
    result = discover(here.mechanism, here.tables[0], holdout=0.25, search=QUICK)
    found = result.found
    fit, poses = found.final, found.poses
    like = poses_at(here.mechanism, poses.dataset, here.new)
    true = next(c for c in catalogue.candidates(here.mechanism, poses.states) if c.name == name)
    standard = {e.name for e in found.standard_model}
    kept = [k for k, e in enumerate(fit.model.effects) if e.name in standard]
    told = replace(
        fit,
        model=ErrorModel(here.mechanism, (*(fit.model.effects[k] for k in kept), *true.effects)),
        theta=np.append(fit.theta[kept], np.zeros(len(true.effects))),
        free=np.append(fit.free[kept], np.ones(len(true.effects), dtype=bool)),
    )
    truth = exact(told, like)
    geometry = [(fit.theta[k], truth.theta[i], fit.stderr[k], _alone(fit)[k])
                for i, k in enumerate(kept) if fit.free[k]]  # fmt: skip
    saved = result.model.saved
    observed = observe(fit.model, like, fit.theta, fit.placement)
    off = observed.tip[:, :3, 3] - here.new.clean
    within = np.abs(off) <= coverage_factor(fit.freedom) * coordinate_deviations(saved, like, observed)
    return {
        "arm": number, "case": case.name, "effect": name, **_findings(found, name),
        "z": {"geometry": _deviations(geometry), **_placed(fit, poses, truth.placed)},
        "predicted": round(float(within.mean()), 3), "k": round(coverage_factor(fit.freedom), 3),
    }  # fmt: skip


def rig(number: int) -> Row:
    """One rig likewise, without its geometry."""
    kind, on_axis = ("lobes", "sin2J1")[number % 2], number % 4 < 2
    made, data = rig_of(500 + number, kind, on_axis)
    poses = prepare(JOINT, data)
    rows = np.arange(len(poses))
    found = over_causes(run_loop(JOINT, poses, rows, rows[:0], search=QUICK))
    frame, tool = made.registration, np.subtract(made.joint.tooling_ball, JOINT.tooling_ball)
    truth = [*frame[:3, 3], *se3.rotation_vector(frame[:3, :3]), *tool]
    names = [p.name for p in sorted(found.final.placement_numbers, key=lambda p: p.name.startswith("tool"))]
    placed = _placed(found.final, poses, dict(zip(names, truth, strict=True)))
    return {"rig": number, "case": f"{kind}, {'on' if on_axis else 'off'} the axis", **_findings(found), "z": placed,
            "k": round(coverage_factor(found.final.freedom), 3)}  # fmt: skip


def _findings(found: Discovery, true: str = "") -> Row:
    """Names of the findings; whether they have other causes; how many effects else may be there; sizes and stated
    probabilities of the credible sets, and whether one of them has the true effect."""
    sets = [one.hypothesis.causes for one in found.findings if one.hypothesis.causes is not None]
    return {
        "found": [c.name for c in found.fitted.candidates], "confirmed": found.confirmed,
        "several": any(len(one.causes) > 1 or one.none > 0 for one in sets),
        "others": len(found.final.covariance.alternatives), "inside": any(true in one.names for one in sets),
        "sizes": [len(one.causes) for one in sets],
        "stated": [round(sum(cause.probability for cause in one.causes), 4) for one in sets],
    }  # fmt: skip


def _alone(fit: Calibration) -> np.ndarray:
    """Standard errors (E,) by the stated fit."""
    return np.asarray(np.sqrt(np.diag(fit.covariance.values)[len(fit.covariance.placement) :]))


def _placed(fit: Calibration, poses: Poses, truth: dict[str, float]) -> dict[str, list[list[float]]]:
    first = len(fit.covariance.placement)
    alone = placement_numbers(fit.placement, problem_at(fit, poses), fit.covariance.values[:first, :first])
    out: dict[str, list[tuple[float, float, float, float]]] = {}
    order = [number.name for number in fit.placement_numbers]
    for p, single in zip(fit.placement_numbers, sorted(alone, key=lambda a: order.index(a.name)), strict=True):
        kind = "tool" if p.name.startswith("tool") else "registration"
        out.setdefault(kind, []).append((p.value, truth[p.name], p.stderr, single.stderr))
    return {kind: _deviations(values) for kind, values in out.items()}


def _deviations(values: list[tuple[float, float, float, float]]) -> list[list[float]]:
    """z over the causes and by the stated fit."""
    return [[round((v - t) / s, 2), round((v - t) / a, 2)] for v, t, s, a in values if s > 0 and a > 0]


def summarised(rows: list[Row]) -> Row:
    """Shares of numbers within k σ, over the causes and by the stated fit, and the farthest z of each."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        shipped = row["found"] and row["confirmed"]
        how = ("several causes" if row["several"] else "one cause") if shipped else "nothing shipped"
        groups.setdefault(f"{'arms' if 'arm' in row else 'rigs'}, {how}", []).append(row)
    return {name: _covered(own) for name, own in sorted(groups.items())}


def _covered(rows: list[Row]) -> Row:
    out: Row = {"machines": len(rows)}
    for kind in ("tool", "registration", "geometry"):
        z = np.array([[abs(v) / row["k"] for v in pair] for row in rows for pair in row["z"].get(kind, [])])
        if len(z):
            over, alone = np.mean(z <= 1.0, axis=0)
            most = 1.96 * z.max(axis=0)
            out[kind] = {"numbers": len(z), "over causes": round(float(over), 3), "one fit": round(float(alone), 3),
                         "farthest": [round(float(v), 1) for v in most]}  # fmt: skip
    if "predicted" in rows[0]:
        out["predicted coordinates"] = round(float(np.mean([row["predicted"] for row in rows])), 3)
    return out


def main() -> None:
    chosen = parsed(__doc__, arms=100, rigs=20, first=0, seconds=np.inf, out=Path)
    jobs = [("rig", chosen.first + k, rig) for k in range(chosen.rigs)]
    jobs += [("arm", chosen.first + k, arm) for k in range(chosen.arms)]
    run_jobs(chosen.out, "machines", jobs, chosen.seconds, summarised)


if __name__ == "__main__":
    main()
