"""Measure how often noise that neighbouring poses share gives a false finding, by three rules.

From the root of the repository: python -m experiments.coverage.dependence --trials 40 --out FILE
The residual of a robot without an effect is replaced by white noise plus equally large noise that rows or regions
share. Rules: permuted poses; also the tests of dependence of `discover`; also permuted stretches of rows and regions.
Errors of instrument and set-up are no candidates. A true effect in the noise shows the cost of each rule.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from experiments.blind.case import Case
from experiments.coverage.measure import bench
from experiments.options import parsed
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.dependence import inflation, regions
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import gains_by_inflation, scores
from gpmodel.evolution.chance import chance_of
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates
from gpmodel.model.error_model import ErrorModel
from gpmodel.model.sites import geometric_effects
from gpmodel.table.blocks import stretches

CASE = Case("innocent", "kuka_like", 120, 0.03, columns=("temperature",))
PLANTED = "joint compliance, J3"
EVERY = 4
"""Offered fraction of the catalogue: one candidate in `EVERY`."""
OF_THE_SESSION = ("instrument", "drift", "set_up_step", "tool_slip")
"""Families that are right to stand out of such noise: they are not offered, so that whatever passes is wrong."""
SHUFFLES = 99
Draw = Callable[[Residual, np.random.Generator], np.ndarray]


def rows(residual: Residual, rng: np.random.Generator) -> np.ndarray:
    """(N, 3): a random walk along the rows, of mean square one."""
    walk = np.cumsum(rng.normal(size=(len(residual.poses), 3)), axis=0)
    walk -= walk.mean(axis=0)
    return np.asarray(walk / np.sqrt(np.mean(walk**2)))


def space(residual: Residual, rng: np.random.Generator) -> np.ndarray:
    """(N, 3): a smooth field, waves of 1.2 to 3 m in random directions, of mean square one."""
    at = np.column_stack([residual.poses.states[axis] for axis in "xyz"])
    waves = rng.normal(size=(12, 3))
    waves *= (2 * np.pi / rng.uniform(1.2, 3.0, 12) / np.linalg.norm(waves, axis=1))[:, None]
    field = np.sin(at @ waves.T + rng.uniform(0, 2 * np.pi, 12)) @ rng.normal(size=(12, 3))
    return np.asarray(field / np.sqrt(np.mean(field**2)))


def drawn(residual: Residual, shared: Draw | None, planted: np.ndarray, rng: np.random.Generator) -> Residual:
    """The residual with other noise: white of σ and shared of σ, and an effect in it."""
    noise = rng.normal(size=(len(residual.poses), 3)) + (shared(residual, rng) if shared else 0.0)
    target = np.zeros(len(residual.values))
    target[: residual.measured] = 1e-5 * noise[residual.problem.weights[:, :3] > 0] + planted
    return replace(residual, target=target, values=residual.span.remove(target))


def stopped(there: Residual, pool: list[Candidate], rng: np.random.Generator) -> dict[str, bool]:
    """Return whether the best candidate passes, by rule; none passes if its gain is below its description length."""
    nats = [score.nats for score in scores(there, pool)]
    best = int(np.argmax(nats))
    worth, limits = nats[best], there.criteria
    units = {
        "poses": there.block_of_pose,
        "stretches": stretches(there.poses.states["row"], limits.fewest_blocks),
        "regions": regions(np.column_stack([there.poses.states[axis] for axis in "xyz"]), limits.fewest_blocks),
    }
    p = {}
    for name, unit in units.items():
        trials = replace(there, block_of_pose=unit).permuted(rng, SHUFFLES)
        null = np.array([max(score.nats for score in scores(replace(there, values=trial), pool)) for trial in trials.T])
        p[name] = chance_of(worth, null).p < limits.significance
    kept = gains_by_inflation(there, pool[best], tuple(inflation(there, pool[best]).values()))
    plain = p["poses"] and worth > limits.minimum_nats
    return {
        "single poses": plain, "and tests of dependence": plain and min(kept) > limits.minimum_nats,
        "and whole stretches and regions": plain and p["stretches"] and p["regions"],
    }  # fmt: skip


def main() -> None:
    settings = parsed(__doc__, trials=40, out=None)
    here = bench(CASE, 1)
    fit = calibrate(ErrorModel(here.mechanism, geometric_effects(here.mechanism)), here.poses)
    residual = residual_of(fit, here.poses, Criteria(), 0)
    every = candidates(here.mechanism, here.poses.states)
    true = next(c for c in every if c.name == PLANTED)
    column = residual.columns(true.effects)[:, 0]
    left = np.linalg.norm(residual.projected(true.effects)[0][: residual.measured, 0]) * np.linalg.norm(column)
    own = [c for c in every if not c.family.startswith(OF_THE_SESSION) and c.name != PLANTED]
    pool = [true, *own[::EVERY]]
    found = {}
    for name, shared in (("white", None), ("rows", rows), ("space", space)):
        for size in (0.0, 8.0):
            passed = []
            for trial in range(settings.trials):
                rng = np.random.default_rng([trial, int(size)])
                passed.append(stopped(drawn(residual, shared, size * 1e-5 / left * column, rng), pool, rng))
            said = {rule: round(float(np.mean([p[rule] for p in passed])), 3) for rule in passed[0]}
            found[f"{name}, {'effect of 8 sigma' if size else 'nothing'}"] = said
            print(name, size, said, flush=True)
            if settings.out:
                settings.out.write_text(json.dumps({"trials": settings.trials, "passes": found}, indent=1) + "\n")


if __name__ == "__main__":
    main()
