"""Test that both representations combine only admissible kinds of quantities."""

import numpy as np
import pytest

from gpmodel.errors import InputError
from gpmodel.evolution.kinds import Typing, result
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.representation import Representation, program_of
from gpmodel.evolution.search import evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.evolution.tree import Tree
from gpmodel.formula.expression import parse
from gpmodel.formula.operators import operator_set

NAMES = ("J1", "J4", "J6", "z", "torque_J2", "temperature", "order", "flag")
KINDS = ("angle", "angle", "short angle", "length", "torque", "temperature", "row", "number")
TYPING = Typing(KINDS)
REPRESENTATIONS = [Linear(operators="thesis"), Linear(length=120), Tree(), Tree(depth=8, operators="physics")]


def inputs(poses: int = 60) -> Inputs:
    return Inputs(NAMES, np.random.default_rng(0).uniform(-1.5, 1.5, (len(NAMES), poses)), KINDS)


@pytest.mark.parametrize(
    "law",
    [
        "cos(2*J4 + 0.7)", "sin(J1 - J4)", "J4*cos(J1)", "tanh(3*J1)",
        "exp(-2*square(J1 - 0.6))", "max(abs(J1) - 0.8, 0)", "J6*J6*temperature", "torque_J2*abs(torque_J2)",
        "tanh(torque_J2/3)", "temperature*sin(J1)", "exp(-5*order)", "max(order - 0.3, 0)*sin(J1)",
        "tanh(20*(order - 0.2))", "sin(J1)/(1.5 + cos(J1))", "z*z*torque_J2", "z/z", "sin(J1)*abs(sin(J1))",
        "flag*torque_J2", "max(torque_J2 - 0.2, 0)", "J1 + J6",
    ],
)  # fmt: skip
def test_laws_of_the_field_may_be(law: str) -> None:
    assert TYPING.allows(parse(law), NAMES)


@pytest.mark.parametrize(
    "law",
    [
        "cos(J4)/exp(min(J1, (order - 480)/290))", "tanh(max(J1, J4))", "exp(J4)*cos(square(J4))", "J1*J4",
        "J1/(exp(J1) + z)*cos(J4)", "J1 + z", "torque_J2 - temperature", "sin(torque_J2)", "sin(order)", "sin(sin(J1))",
        "max(J1, order)", "square(order)", "order + J1", "z/torque_J2", "exp(cos(J1))", "min(sin(J1), cos(J4))",
        "tanh(tanh(J1))",
    ],
)  # fmt: skip
def test_what_compares_lengths_with_angles_may_not(law: str) -> None:
    assert not TYPING.allows(parse(law), NAMES)
    assert Typing().allows(parse(law), NAMES)


@pytest.mark.parametrize("representation", REPRESENTATIONS, ids=lambda r: f"{type(r).__name__} {r.operators}")
def test_every_random_and_every_bred_program_is_of_its_kinds(representation: Representation) -> None:
    rng = np.random.default_rng(3)
    layout = representation.layout(inputs(), ())
    population = representation.initial(layout, 150, rng)
    seen = set()
    for _ in range(3):
        for row in range(150):
            program = program_of(population, row, layout)
            assert TYPING.allows(program, NAMES), program
            seen |= set(program.inputs)
        mothers, fathers = rng.integers(0, 150, (2, 150))
        population = representation.offspring(layout, population, mothers, fathers, rng)
    assert seen == set(NAMES)


@pytest.mark.long
@pytest.mark.parametrize("representation", [Linear(), Tree()], ids=["linear", "tree"])
@pytest.mark.parametrize("law", ["sin(2*J4 + 0.7)", "temperature*sin(J1)", "tanh(3*J1)", "cos(J1)*max(order, 0)"])
def test_a_search_finds_a_law_of_its_kinds_and_no_other(representation: Representation, law: str) -> None:
    there = inputs(80)
    noise = 0.02 * np.random.default_rng(1).normal(size=80)
    problem = SlotProblem(there, regression(parse(law).evaluate(there.mapping())[0] + noise), parsimony=2.0)
    budget = Budget(400, 40, seconds=1e9, climb=2)
    found = evolve(problem, Settings(representation, budget=budget), np.random.default_rng(2))
    assert found.best.gain > 0.97
    assert all(TYPING.allows(solution.program, NAMES) for solution in found.front)


def test_an_operator_that_may_not_be_is_replaced_by_the_next_that_may() -> None:
    operators = operator_set("slot")
    table, number = TYPING.repairs(operators), TYPING.kinds.index
    code = {operator.name: operator.code for operator in operators}
    assert table[code["sin"], number("angle"), 0] >> 8 == code["sin"]
    assert table[code["sin"], number("torque"), 0] >> 8 == code["exp"]
    assert table[code["add"], number("torque"), number("temperature")] >> 8 == code["multiply"]
    assert table[code["add"], number("angle"), number("torque")] == 0
    assert Typing().repairs(operators).size == 0


def test_kinds_are_counted_and_a_result_is_a_known_kind() -> None:
    with pytest.raises(InputError, match="1 kinds for 2 names"):
        Inputs(("a", "b"), np.ones((2, 5)), ("angle",))
    for operator in operator_set("thesis"):
        for first in TYPING.kinds:
            for second in TYPING.kinds[:: 1 if operator.arity == 2 else 99]:
                made = result(operator.name, *(first, second)[: operator.arity])
                assert made is None or made in TYPING.kinds
