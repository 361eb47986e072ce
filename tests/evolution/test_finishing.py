"""Test that formulas bred from the best programs complete them and gain little on noise."""

from dataclasses import replace

import numpy as np
import pytest

from gpmodel.evolution.pareto import Solution, scored
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.search import _finished, evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.formula.expression import parse

POSES = 80
NAMES = ("J1", "J2", "J3", "load")
INPUTS = Inputs(NAMES, np.random.default_rng(8).uniform(-1.5, 1.5, (4, POSES)))
KINDS = ("angle", "angle", "angle", "torque")
SLOT = Settings().representation.layout(INPUTS, ())


def problem(law: str, noise: float = 0.02, seed: int = 0) -> SlotProblem:
    response = parse(law).evaluate(INPUTS.mapping())[0]
    spread = noise * response.std() * np.random.default_rng(seed).normal(size=POSES)
    return SlotProblem(INPUTS, regression(response + spread), parsimony=2.0)


@pytest.mark.first(1)
@pytest.mark.parametrize("kinds", [(), KINDS])
@pytest.mark.parametrize(
    ("law", "near"),
    [
        ("sin(2*J2)*cos(J1)", "J2*cos(J1)"),
        ("J1*tanh(load)", "J1"),
        ("abs(J1 - J2)", "J1 - J2"),
        ("cos(3*J1) + J2*0", "cos(J1)"),
    ],
)
def test_a_near_miss_is_finished(law: str, near: str, kinds: tuple[str, ...]) -> None:
    there = replace(problem(law), inputs=replace(INPUTS, kinds=kinds))
    found = _finished((scored(parse(near), there),), there, SLOT, 1)
    assert found[-1].gain > 0.99
    assert all({*one.program.operator_counts} <= {o.name for o in SLOT.operators} for one in found)


@pytest.mark.parametrize(
    "text", ["J1", "J1*cos(J2)", "v = sin(J1); v*v + load, max(v, 0.5)", "exp(J3), J1, abs(J2 - J3)"]
)
def test_a_finished_front_costs_no_description_length(text: str) -> None:
    there = problem("sin(J1*J2) + load", 2.0)
    start = scored(parse(text), there)

    def nats(one: Solution) -> float:
        return float(there.nats(one.gain, one.complexity + len(one.coefficients)))

    assert max(map(nats, _finished((start,), there, SLOT, 1))) >= nats(start)


def test_on_noise_little_is_gained() -> None:
    """On 80 poses of noise, evolution and breeding cost more nodes than they gain, at 2 nats a node."""
    there = SlotProblem(INPUTS, regression(np.random.default_rng(4).normal(size=POSES)), parsimony=2.0)
    found = evolve(there, Settings(budget=Budget(256, 20, seconds=1e9, climb=2)), np.random.default_rng(1))
    saved = -0.5 * POSES * np.log(1.0 - found.best.gain) - 2.0 * found.best.complexity
    assert saved < 5.0
