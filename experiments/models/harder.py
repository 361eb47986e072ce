"""Compare hand-made models and `discover` on an arm with compliances of the base and five gears.

From the root of the repository: python -m experiments.models.harder [--seeds 20] [--runs 4] [--first 30] [--masses 0]
[--out FOLDER]. masses: `discover` is given link masses that are wrong by up to so many per cent.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from experiments.chapter5 import options, rounded, save
from experiments.irb6400r_truth import Case, measured_robot
from experiments.models.run import COLUMNS, STEPS, one_robot
from gpmodel.model.error_model import prepare
from robots.chain import SerialChain

SPRINGS = {
    "base_compliance": 6e6, "joint_compliance J2": 4.1e6, "joint_compliance J3": 1.9e6,
    "joint_compliance J4": 2.3e5, "joint_compliance J5": 4e5, "joint_compliance J6": 8e4,
}  # fmt: skip
"""Nm/rad: the base as in the other arms here, gears of an arm of the same size."""
PLANTED = {
    "base": {"base compliance", "joint bending, J1"},
    **{f"J{n}": {f"joint compliance, J{n}"} for n in range(2, 7)},
    "eccentricities": {"eccentricity, 1 per turn, several joints"},
}


def with_wrong_masses(case: Case, percent: int, seed: int) -> Case:
    """The robot with a description whose link masses are off by up to so many per cent, evenly."""
    if not percent:
        return case
    assert isinstance(case.mechanism, SerialChain)
    rng = np.random.default_rng([20, seed])
    links = tuple(
        replace(link, mass=link.mass * (1.0 + 0.01 * percent * rng.uniform(-1.0, 1.0))) for link in case.mechanism.links
    )
    wrong = replace(case.mechanism, links=links)
    return replace(case, mechanism=wrong, poses=prepare(wrong, case.poses.dataset))


def judged(robot: dict[str, Any]) -> dict[str, Any]:
    """A robot's results with which of the seven planted effects are named, and what else is."""
    names = {finding["name"] for finding in robot["found"]}
    named = [what for what, known in PLANTED.items() if known & names]
    return {**robot, "named": named, "other": sorted(names - set.union(*PLANTED.values()))}


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    chosen = options(__doc__, "models", arguments, "harder", seeds=20, runs=4, first=30, masses=0)
    robots: list[dict[str, Any]] = []
    results: dict[str, Any] = {}
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        case = with_wrong_masses(measured_robot(seed, springs=SPRINGS), chosen.masses, seed)
        robots.append(judged(one_robot(seed, chosen.runs, case)))
        print(robots[-1], flush=True)
        medians = rounded(np.median([[r["mm"][s] for s in STEPS] for r in robots], axis=0), 1.0)
        whole = sum(len(r["named"]) == len(PLANTED) and not r["other"] for r in robots)
        results = {
            "columns": COLUMNS,
            "median_mm": dict(zip(STEPS, medians, strict=True)),
            "all seven named and nothing else": f"{whole} of {len(robots)}",
        }
        save(chosen, {**results, "robots": robots}, {}, seeds=len(robots))
    return {**results, "robots": robots}


if __name__ == "__main__":
    main()
