"""Count the random poses that are equivalent to poses chosen by `gpmodel poses --after`.

Simulated robots have one named effect: thirty random poses, a calibration, then chosen or random poses with equal
noise, and a fit to all. Compared are the error and the ± of the fitted effect, the RMS error of the predicted point at
new poses, and the misfit, in sigma, of an alternative effect. A bound by the design alone states the best possible
choice; before.py computes the numbers for the geometry before anything is measured.
From the root of the repository: python -m experiments.next_poses.run [--seeds 6] [--only before|limits|cases]
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.next_poses import before
from experiments.options import parsed
from gpmodel.application.model_file import saved_model
from gpmodel.application.next_poses import Alternatives, PlanningContext
from gpmodel.application.predict import point_deviation
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration
from gpmodel.families.by_name import effects_named
from gpmodel.files import to_json, write_text
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import ErrorModel, Poses, observe, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.planning.design import Design, choose_for_all, deviations
from gpmodel.planning.poses import least_deviation, pool_of
from gpmodel.planning.simulate import Simulation, simulate

FIRST, NOISE, GEOMETRY, LIMIT = 30, 3e-5, 3e-4, 100.0
CHOSEN, RANDOM, FRESH, DRAWS = (5, 10, 20), (5, 10, 20, 40, 80, 160), 300, 5
CASES = (
    ("irb6400r", "joint_compliance J2", "1e-7", "joint_compliance J3"),
    ("irb6400r", "gear_harmonic J4", "100 arcsec", "eccentricity J4"),
    ("ur10", "base_compliance", "2e-6", "joint_compliance shoulder_lift_joint"),
)
MEASURES = {"effect": "stated_percent", "point": "stated_um", "rivals": "rival_apart_sigma"}
"""Number that measures each design goal: the standard error of the fit, which does not depend on one draw of noise."""


@dataclass(frozen=True)
class Robot:
    """True effects of a robot, the effects in question, and alternatives to them."""

    truth: Simulation
    asked: tuple[Effect, ...]
    rival: tuple[Effect, ...]

    def measured(self, q: Array, rng: np.random.Generator, noise: float = NOISE) -> Poses:
        """Poses at q (N, n) as the instrument would have them."""
        made, blank = self.truth, np.full((len(q), 3), np.nan)
        data = replace(made.dataset.subset(np.zeros(len(q), dtype=int)), q=q.copy(), position=blank)
        data = replace(data, row=np.arange(1, len(q) + 1))
        tip = observe(made.model, prepare(made.model.mechanism, data), made.theta, made.placement).tip[:, :3, 3]
        return prepare(made.model.mechanism, replace(data, position=tip + rng.normal(0.0, noise, tip.shape)))

    def fit(self, poses: Poses, beside: tuple[Effect, ...]) -> Calibration:
        """Geometry and some effects beside it."""
        mechanism = self.truth.model.mechanism
        model = ErrorModel(mechanism, geometric_effects(mechanism) + beside)
        return calibrate(model, poses, condition_limit=LIMIT, robust=False)

    def certainty(self, q: Array, seed: int) -> dict[str, float]:
        """Return the precision from poses at q."""
        poses = self.measured(q, np.random.default_rng([seed, 1]))
        right, wrong = self.fit(poses, self.asked), self.fit(poses, self.rival)
        count = len(self.asked)
        true, found = self.truth.theta[-count:], right.theta[-count:]
        mechanism = self.truth.model.mechanism
        fresh = self.measured(
            random_poses(mechanism, FRESH, np.random.default_rng([seed, 2])), np.random.default_rng(0), 0.0
        )
        observed = observe(right.model, fresh, right.theta, right.placement)
        tip, known = observed.tip[:, :3, 3], point_deviation(saved_model(right, poses), fresh, observed)
        worse = np.sum(wrong.error**2) - np.sum(right.error**2)
        return {
            "miss_percent": 100 * float(np.linalg.norm(found - true) / np.linalg.norm(true)),
            "stated_percent": 100 * float(np.linalg.norm(right.stderr[-count:]) / np.linalg.norm(true)),
            "stated_um": 1e6 * float(np.sqrt(np.mean(known**2))),
            "point_um": 1e6 * float(np.sqrt(np.mean(np.sum((tip - fresh.dataset.position) ** 2, axis=1)))),
            "rival_apart_sigma": float(np.sqrt(max(worse, 0.0))) / NOISE,
        }


def robot(case: tuple[str, str, str, str], seed: int) -> tuple[Robot, Array]:
    """A robot and its first poses."""
    name, effect, value, rival = case
    mechanism = MechanismChoice(name).load()
    rng = np.random.default_rng([seed, 0])
    q = random_poses(mechanism, FIRST, rng)
    truth = simulate(mechanism, q, (f"{effect}={value}",), rng, geometry_sigma=GEOMETRY)
    states = prepare(mechanism, truth.dataset).states
    return Robot(truth, effects_named(effect, mechanism, states), effects_named(rival, mechanism, states)), q


def asked(made: Robot, first: Array, seed: int) -> tuple[dict[str, Design], Array]:
    """Return the design questions of the poses, and their pool."""
    mechanism, rng = made.truth.model.mechanism, np.random.default_rng([seed, 3])
    poses = made.measured(first, np.random.default_rng([seed, 1]))
    outlook = PlanningContext.from_joint_values(
        saved_model(made.fit(poses, made.asked), poses), pool := pool_of(mechanism, max(RANDOM), rng), rng
    )
    count = len(made.asked)
    finding = Alternatives("asked", np.arange(len(outlook.saved.theta))[-count:])
    questions = {
        "effect": outlook.finding_problem(finding),
        "point": outlook.point_problem(),
        "rivals": outlook.separation(finding, made.rival),
    }
    return questions, pool


def limits(case: tuple[str, str, str, str], seeds: int) -> dict[str, Any]:
    """By what the poses are for, how many random ones tell as much, by the design, as the best conceivable ones."""
    best: dict[str, list[list[float]]] = {name: [] for name in MEASURES}
    for seed in range(seeds):
        questions, pool = asked(*robot(case, seed), seed)
        rng = np.random.default_rng([seed, 5])
        for name, question in questions.items():
            draws = [deviations((question,), rng.choice(len(pool), max(RANDOM), replace=False)) for _ in range(DRAWS)]
            random = [float(value) for value in np.mean(draws, axis=0)[list(RANDOM)]]
            best[name].append([needed(random, least_deviation((question,), n)) for n in CHOSEN])
    medians = {name: np.median(rows, axis=0).round(1).tolist() for name, rows in best.items()}
    out = {name: dict(zip(CHOSEN, row, strict=True)) for name, row in medians.items()}
    print(case[0], case[1], "limit", out, flush=True)
    return {"arm": case[0], "effect": case[1], "limit": out}


def needed(numbers: list[float], wanted: float) -> float:
    """Random poses that tell as much, between those tried; the most tried where even they do not."""
    values = np.array(numbers)
    rising = values[-1] > values[0]
    good = values >= wanted if rising else values <= wanted
    if not good.any():
        return float(RANDOM[-1])
    at = int(np.argmax(good))
    if at == 0:
        return float(RANDOM[0])
    x = np.log([values[at - 1], values[at]])
    part = (np.log(wanted) - x[0]) / (x[1] - x[0])
    return float(np.exp(np.interp(part, [0, 1], np.log([RANDOM[at - 1], RANDOM[at]]))))


def rms(rows: list[dict[str, float]]) -> dict[str, float]:
    """Root mean squares over the seeds, of every number."""
    return {name: round(float(np.sqrt(np.mean([row[name] ** 2 for row in rows]))), 4) for name in rows[0]}


def study(case: tuple[str, str, str, str], seeds: int) -> dict[str, Any]:
    """One robot over the seeds."""
    chosen: dict[str, dict[int, list[dict[str, float]]]] = {name: {n: [] for n in CHOSEN} for name in MEASURES}
    random: dict[int, list[dict[str, float]]] = {n: [] for n in RANDOM}
    for seed in range(seeds):
        made, first = robot(case, seed)
        questions, pool = asked(made, first, seed)
        for name, question in questions.items():
            q = pool[choose_for_all((question,), max(CHOSEN))]
            for n in CHOSEN:
                chosen[name][n].append(made.certainty(np.vstack([first, q[:n]]), seed))
        draw = pool[np.random.default_rng([seed, 4]).permutation(len(pool))]
        for n in RANDOM:
            random[n].append(made.certainty(np.vstack([first, draw[:n]]), seed))
    by_chance = {n: rms(rows) for n, rows in random.items()}
    out: dict[str, Any] = {"arm": case[0], "effect": case[1], "rival": case[3], "random": by_chance, "chosen": {}}
    for name, measure in MEASURES.items():
        told = {n: rms(rows) for n, rows in chosen[name].items()}
        as_good = {n: round(needed([by_chance[m][measure] for m in RANDOM], told[n][measure]), 1) for n in CHOSEN}
        out["chosen"][name] = {"after": told, "random_poses_as_good": as_good}
        print(case[0], case[1], name, as_good, flush=True)
    return out


def main(arguments: list[str] | None = None) -> dict[str, Any]:
    out = Path(__file__).with_name("results.json")
    given = parsed(__doc__, arguments, seeds=6, only=("", "before", "limits", "cases"), out=out)
    makers: dict[str, Callable[[], list[dict[str, Any]]]] = {
        "before": lambda: [before.study(arm) for arm in before.ARMS],
        "limits": lambda: [limits(case, given.seeds) for case in CASES],
        "cases": lambda: [study(case, given.seeds) for case in CASES],
    }
    results = json.loads(given.out.read_text()) if given.only and given.out.is_file() else {}
    for part, make in makers.items():
        if given.only in ("", part):
            command = f"python -m experiments.next_poses.run --only {part} --seeds {given.seeds}"
            results[part] = {"command": command, "first_poses": FIRST, "studies": make()}
    write_text(given.out, to_json(results))
    return results


if __name__ == "__main__":
    main()
