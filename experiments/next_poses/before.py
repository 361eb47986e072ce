"""Count the random poses that determine the geometry as well as chosen poses, before any measurement.

By linear algebra alone: the pool of candidates is the workspace, random poses are drawn from it.
"""

from typing import Any

import numpy as np

from gpmodel.arrays import Array, IntArray
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.planning.design import LITTLE, Design, choose
from gpmodel.planning.poses import GOALS, geometric_problem, least_deviation, pool_of, spread_among

ARMS, CHOSEN, DRAWS, POOL, NOISE = ("irb6400r", "ur10", "panda"), (20, 40, 80), 20, 1000, 3e-5
RANDOM = (15, 20, 25, 30, 35, 40, 50, 60, 80, 100, 130, 160, 200, 260, 320)


def told(question: Design, taken: IntArray) -> dict[str, float]:
    """Return the precision of poses: standard error of the point, m, RMS and worst over the pool; of the worst
    combination of unknowns, and of all unknowns together, scale-free.
    """
    columns, count = question.columns, len(question.known)
    rows = columns[taken].reshape(-1, count)
    information = LITTLE * np.eye(count) + rows.T @ rows
    inverse = np.linalg.inv(information)
    variance = NOISE**2 * np.sum((columns @ inverse) * columns, axis=(1, 2))
    return {
        "mean": float(np.sqrt(variance.mean())),
        "worst": float(np.sqrt(variance.max())),
        "e-optimal": float(np.linalg.eigvalsh(information)[0] ** -0.5),
        "d-optimal": float(np.exp(-0.5 * np.linalg.slogdet(information)[1] / count)),
    }


def as_many(random: Array, wanted: float) -> float:
    """Random poses that leave no more, by what so many of RANDOM (R,) leave; the most tried where even they leave
    more."""
    return round(float(np.exp(np.interp(-np.log(wanted), -np.log(random), np.log(RANDOM)))), 1)


def study(arm: str) -> dict[str, Any]:
    """By criterion and number of chosen poses, the random ones that tell as much: by each measure."""
    rng = np.random.default_rng(0)
    mechanism = MechanismChoice(arm).load()
    pool = pool_of(mechanism, POOL // 20, rng)
    question = geometric_problem(mechanism, pool, NOISE)
    draws = [[told(question, rng.choice(len(pool), n, replace=False)) for _ in range(DRAWS)] for n in RANDOM]
    random = {k: np.array([np.median([draw[k] for draw in some]) for some in draws]) for k in draws[0][0]}
    out: dict[str, Any] = {"arm": arm, "unknowns": len(question.known), "chosen": {}}
    for n in CHOSEN:
        designs = {name: choose(question.columns, question.known, n, goal(question.columns))
                   for name, goal in GOALS.items()}  # fmt: skip
        designs["spread"] = spread_among(mechanism, pool, n)
        cells = {name: {k: as_many(random[k], v) for k, v in told(question, d).items()} for name, d in designs.items()}
        cells["limit"] = {"mean": as_many(random["mean"], least_deviation((question,), n))}
        out["chosen"][n] = cells
        print(arm, n, cells, flush=True)
    return out
