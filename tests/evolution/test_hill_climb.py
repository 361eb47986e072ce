"""Climbing by single edits: every edit is what it says, the climb never loses, and it reaches what evolution missed."""

from dataclasses import replace

import numpy as np
import pytest

from gpmodel.evolution.building_blocks import Vocabulary, promising
from gpmodel.evolution.hill_climb import _edits, _outputs_after, _rebuilt, climbed
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.formula.operators import operator_set
from gpmodel.formula.parse import parse
from gpmodel.formula.program import Program

POSES = 80
NAMES = ("J1", "J2", "J3", "load")
INPUTS = Inputs(NAMES, np.random.default_rng(8).uniform(-1.5, 1.5, (4, POSES)))
MEASURED = replace(INPUTS, kinds=("angle", "angle", "angle", "torque"))
WORDS = Vocabulary(INPUTS, operator_set("slot"))
OF_KINDS = Vocabulary(MEASURED, operator_set("slot"))
PROGRAMS = ["J1", "J1*cos(J2)", "v = sin(J1); v*v + load, max(v, 0.5)", "exp(J3), J1, abs(J2 - J3)"]


def problem(law: str, noise: float = 0.02, seed: int = 0) -> SlotProblem:
    response = parse(law).evaluate(INPUTS.mapping())[0]
    spread = noise * response.std() * np.random.default_rng(seed).normal(size=POSES)
    return SlotProblem(INPUTS, regression(response + spread), parsimony=2.0)


@pytest.mark.parametrize("text", PROGRAMS)
def test_every_edit_has_the_values_of_the_program_that_it_builds(text: str) -> None:
    program = parse(text)
    whole = Program(program.nodes, tuple(range(len(program.nodes))))
    values = list(whole.evaluate(INPUTS.mapping()))
    rng = np.random.default_rng(0)
    with np.errstate(all="ignore"):
        for node in range(len(program.nodes) + (len(program.outputs) < 3)):
            edits = _edits(program, node, values, [0] * len(values), WORDS)
            assert len(edits.values) == len(edits.growth)
            outputs = np.broadcast_arrays(*_outputs_after(program, node, values, edits.values))
            expected = np.stack(outputs, axis=1)
            for k in rng.integers(0, len(edits.values), 60).tolist():
                built = _rebuilt(program, node, edits, k)
                np.testing.assert_allclose(built.evaluate(INPUTS.mapping()), expected[k], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("law", "near", "words"),
    [
        ("sin(2*J2)*cos(J1)", "J2*cos(J1)", OF_KINDS),
        ("J1*tanh(load)", "J1", WORDS),
        ("abs(J1 - J2)", "J1 - J2", OF_KINDS),
        ("max(load, J3)", "min(load, J3)", WORDS),
        ("cos(3*J1) + J2*0", "cos(J1)", OF_KINDS),
    ],
)
def test_a_near_miss_is_finished(law: str, near: str, words: Vocabulary) -> None:
    there = problem(law)
    found = climbed(parse(near), there, 0, words)
    assert there.targets.set_gain(found.evaluate(INPUTS.mapping()), 0)[0] > 0.99


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("text", PROGRAMS)
def test_a_climb_never_costs_description_length(text: str, seed: int) -> None:
    there = problem("sin(J1*J2) + load", 2.0, seed)

    def nats(program: Program) -> float:
        gain = there.targets.set_gain(program.evaluate(INPUTS.mapping()), 0)[0]
        return -0.5 * POSES * np.log(1.0 - gain) - 2.0 * (program.complexity + len(program.outputs))

    start = parse(text)
    assert nats(climbed(start, there, 0, WORDS)) >= nats(start)


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("cos(2*J1)*cos(2*J2)", OF_KINDS),
        ("sin(J1)*load", OF_KINDS),
        ("exp(J1)*abs(J3)", WORDS),
        ("tanh(J2 + J3)", OF_KINDS),
    ],
)
def test_a_pair_that_explains_only_together_is_among_the_promising(law: str, words: Vocabulary) -> None:
    there = problem(law)
    ((program, site),) = promising(there, words, 1)
    assert there.targets.set_gain(program.evaluate(INPUTS.mapping()), site)[0] > 0.99


def test_a_search_that_climbs_finds_a_law_that_the_same_search_misses() -> None:
    there = replace(problem("cos(2*J1)*cos(2*J2)"), inputs=MEASURED)
    without, with_climb = (
        evolve(there, Settings(budget=Budget(64, 5, seconds=1e9, climb=climb)), np.random.default_rng(3))
        for climb in (0, 2)
    )
    assert without.best.gain < 0.6
    assert with_climb.best.gain > 0.99
    gains = [c.gain for c in with_climb.front]
    assert gains == sorted(gains)
    assert [c.complexity for c in with_climb.front] == sorted(c.complexity for c in with_climb.front)


def test_on_noise_a_climb_gains_little() -> None:
    """On 80 poses of noise, evolution and climbing cost more nodes than they gain, at 2 nats a node."""
    there = SlotProblem(INPUTS, regression(np.random.default_rng(4).normal(size=POSES)), parsimony=2.0)
    found = evolve(there, Settings(budget=Budget(256, 20, seconds=1e9, climb=2)), np.random.default_rng(1))
    saved = -0.5 * POSES * np.log(1.0 - found.best.gain) - 2.0 * found.best.complexity
    assert saved < 5.0
