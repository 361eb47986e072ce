"""Families that remember: what they find, and what they make of robots, repeats and instruments that are innocent."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import bare, measure, mechanism, sized

from gpmodel.arrays import Array
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.residual import Residual, residual_of
from gpmodel.evidence.score import best_nats, scores
from gpmodel.families import memory
from gpmodel.families.candidate import Candidate
from gpmodel.families.catalogue import candidates
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.dataset import Dataset

ARM = mechanism("irb6400r")
FAMILIES = {"play_last_move", "friction_windup", "hysteresis", "lagged_growth", "settling"}
FLOOR = 5.0


@cache
def table(kind: str = "poses") -> Dataset:
    """120 rows in order over 5 hours: independent poses, a walk, or 40 poses measured three times with jitter."""
    data = bare("irb6400r", 120, 3, payload=False)
    rng = np.random.default_rng(4)
    q = data.q.copy()
    if kind == "walk":
        q = np.clip(np.cumsum(0.08 * rng.normal(size=q.shape), axis=0) + q[0], q.min(0), q.max(0))
    if kind == "repeats":
        q = np.repeat(q[:40], 3, axis=0) + 2e-5 * rng.normal(size=q.shape)
    time = np.cumsum(rng.uniform(1.0, 4.0, 120))
    room = 21.0 + 3.0 * np.sin(2 * np.pi * time / 260.0)
    return replace(
        data, q=q, extras={"time": time, "temperature": room}, extra_units={"time": "min", "temperature": "degC"}
    )


def pool(data: Dataset) -> tuple[Candidate, ...]:
    return candidates(ARM, prepare(ARM, data).states)


def left_over(data: Dataset, effects: tuple, theta: Array, moved: Array | None = None) -> Residual:
    truth = measure("irb6400r", effects, theta, 5, dataset=data)
    poses = truth.poses
    if moved is not None:
        poses = prepare(ARM, replace(poses.dataset, position=poses.dataset.position + moved))
    return residual_of(calibrate(ErrorModel(ARM, geometric_effects(ARM)), poses), poses, Criteria(), 0)


PLANTED = {
    "play by the last move, J2": "poses",
    "friction windup, J3": "walk",
    "hysteresis over its angle, J1": "walk",
    "growth of the arm (temperature, lag of 53 min)": "poses",
    "tilt of J1 (temperature, lag of 53 min)": "poses",
}


@pytest.mark.long
@pytest.mark.parametrize(("name", "kind"), PLANTED.items())
def test_of_the_whole_catalogue_the_planted_one_saves_most(name: str, kind: str) -> None:
    offered = {c.name: c for c in pool(table(kind))}
    there = left_over(table(kind), offered[name].effects, sized("irb6400r", offered[name].effects, table(kind), 0.3))
    best = max(zip(offered, scores(there, tuple(offered.values())), strict=True), key=lambda pair: pair[1].nats)
    assert best[0] == name
    assert best[1].nats > 20.0


@pytest.mark.parametrize("kind", ["poses", "walk", "repeats"])
def test_an_innocent_robot_has_no_memory(kind: str) -> None:
    there = left_over(table(kind), (), np.zeros(0))
    mine = [c for c in pool(table(kind)) if c.family in FAMILIES]
    assert len(mine) > 300
    rng = np.random.default_rng(0)
    assert max(s.nats for s in scores(there, mine)) < FLOOR
    assert np.mean(best_nats(there, mine, rng.normal(size=(len(there.values), 40))) < FLOOR) > 0.9


@pytest.mark.long
def test_a_drifting_instrument_is_called_a_drift() -> None:
    data = table()
    creep = 4e-4 * np.linspace(0.0, 1.0, 120)[:, None] * np.array([0.6, -0.5, 0.62])
    there = left_over(data, (), np.zeros(0), creep)
    offered = pool(data)
    best = offered[int(np.argmax([s.nats for s in scores(there, offered)]))]
    assert best.family == "drift"


def test_without_an_order_of_the_rows_nothing_remembers() -> None:
    data = replace(table(), extras={}, extra_units={})
    assert not {c.family for c in pool(data)} & FAMILIES
    said = {c.family for c in pool(replace(data, in_order=True))}
    assert said & FAMILIES == {"play_last_move", "friction_windup", "hysteresis", "settling"}
    assert not [c for f in (memory.play_last_move,) for c in f(ARM, prepare(ARM, data).states)]
