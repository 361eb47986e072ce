"""Error of `predict` with and without instrument errors, at exact positions of new poses.

Every robot has geometric errors, a second joint that yields and hardens, and 0.03 mm of noise. Some tables are in the
frame of the robot itself, some in that of a tracker, some of these with an error of the tracker. With --discovers 0 the
true model is fitted to tables with an error of the tracker, and nothing is searched.
From the root of the repository: python -m experiments.gauge.run [--robots 40] [--poses 120] [--discovers 1]
[--times 1] [--first 0] [--out FOLDER]
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

import gpmodel as gp
from experiments.chapter5 import options, rounded, save
from experiments.gauge.robots import ARMS, INSTRUMENTS, MOTIONS, PLANTED, Measured, measured
from gpmodel.application.model_file import SavedModel, saved_model
from gpmodel.application.predict import placement_columns
from gpmodel.application.usable import usable
from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.model.error_model import observe, prepare
from gpmodel.numerics import rank, se3
from gpmodel.numerics.least_squares import root_mean_square
from gpmodel.table.dataset import Dataset


def judged(saved: SavedModel, made: Measured) -> dict[str, Any]:
    """RMS, mm, at fresh poses: of predict, the same registered anew, as measured; of their difference, and what of that
    over the measured poses a rigid motion of registration and tool takes up."""
    plain, read = (usable(saved, as_measured=as_measured) for as_measured in (False, True))
    (here, there), (own, other) = (
        [_points(s, data) for s in (plain, read)] for data in (made.fresh, made.poses.dataset)
    )
    turn, shift = se3.fit_rotation(here, made.exact)
    left = [made.exact - here, made.exact - here @ turn.T - shift, made.read - there, there - here]
    values = rounded([root_mean_square(np.linalg.norm(part, axis=1)) for part in left])
    poses = prepare(saved.mechanism, made.poses.dataset)
    observed = observe(plain.model, poses, plain.theta, plain.placement)
    rigid = rank.orthonormal(placement_columns(plain, poses, observed).reshape(3 * len(poses), -1))
    taken = float(np.linalg.norm(rigid.T @ (other - own).ravel())) / np.sqrt(len(poses))
    columns = ("plain_mm", "registered_mm", "as_measured_mm", "difference_mm", "rigid_mm")
    return dict(zip(columns, [*values, rounded(taken)], strict=True))


def _points(saved: SavedModel, data: Dataset) -> Array:
    poses = prepare(saved.mechanism, data)
    return observe(saved.model, poses, saved.theta, saved.placement).tip[:, :3, 3]


def told(made: Measured) -> SavedModel:
    """The model of the truth fitted to the table: nothing is left to be found."""
    return saved_model(calibrate(made.model, made.poses), made.poses)


def one_robot(case: tuple[str, str, str], count: int, seed: int, discovers: bool, times: float) -> dict[str, Any]:
    """Return the error of `predict` for one robot, from a discovery or from the true model fitted to the table."""
    made = measured(case, count, seed, times)
    if not discovers:
        return {"case": list(case), **judged(told(made), made)}
    table, arm = made.poses.dataset, made.model.mechanism
    found = gp.discover(arm, table, holdout=0.3, search=gp.Search(runs=0), seed=seed)
    own = [f.name for f in found.findings if f.slot == "instrument"]
    return {"case": list(case), **judged(found.model.saved, made), "instrument": own}


def main(arguments: list[str] | None = None) -> None:
    chosen = options(__doc__, "gauge", arguments, robots=40, poses=120, discovers=1, times=1, first=0)
    chosen.results = "results.json" if chosen.discovers else "told.json"
    cases = list(product(ARMS, MOTIONS, INSTRUMENTS if chosen.discovers else PLANTED))
    order, done = np.random.default_rng(89).permutation(len(cases)), list[dict[str, Any]]()
    for k in range(chosen.robots):
        case, seed = cases[order[k % len(cases)]], chosen.first + k
        done.append(one_robot(case, chosen.poses, seed, bool(chosen.discovers), chosen.times))
        bare = [r["plain_mm"] / r["as_measured_mm"] for r in done if r["case"][2] not in PLANTED]
        counts = {"robots": len(done), "not_planted": len(bare), "largest_ratio": max(bare, default=None)}
        save(chosen, {**counts, "each": done}, {}, robots=len(done))


if __name__ == "__main__":
    main()
