"""Test that the shortest formula of a smooth curve is found at noise, and none without a curve."""

from itertools import permutations

import numpy as np
import pytest

from gpmodel.errors import InputError
from gpmodel.evolution.formulas import LONGEST, formulas_at, shorter
from gpmodel.evolution.memetic import Formulas, evolve_formulas
from gpmodel.evolution.pareto import Solution
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import Targets, regression
from gpmodel.formula.expression import parse
from gpmodel.formula.program import description_size, length

NAMES = ("J2", "J5", "torque J2", "row")
KINDS = ("angle", "angle", "torque", "row")
INPUTS = Inputs(NAMES, np.random.default_rng(5).uniform(-2.0, 2.0, (4, 90)), KINDS)


def laws_of(problem: SlotProblem, names: tuple[str, ...]) -> tuple[Solution, ...]:
    """Laws at the second place."""
    return formulas_at(problem, 1, names)


def curve(law: str, noise: float, seed: int = 0) -> SlotProblem:
    """A curve with noise, and another place where there is nothing but noise."""
    rng = np.random.default_rng(seed)
    shape = parse(law).evaluate(INPUTS.mapping())[0]
    there = regression(shape + noise * shape.std() * rng.normal(size=90))
    pull = np.vstack([rng.normal(size=90), there.pull[0]])
    targets = Targets(
        np.ones((2, 90)), np.repeat(there.cross, 2, axis=0), pull, there.energy, ("elsewhere", "here"), 90
    )
    return SlotProblem(INPUTS, targets, parsimony=2.0)


BRIEF = [
    ("sin(2*J2 + 0.7)", 6), ("sin(2*J2 + 1.2*J5 - 0.9*row)", 12),
    ("tanh(3*J5)", 4), ("step(J2 - 1.3)", 4), ("J5 - max(min(J5, 0.9), -0.5)", 6),
]  # fmt: skip
LAWS = [
    ("J2*cos(J5)", 4), ("tanh(2*J2)*'torque J2'*(J5 - 0.6)", 12), ("sin(3*J2)*sin(3.5*J5 + 1)", 11),
    ("exp(-6*square(J2 - 0.6))", 7), ("sin(J2 - J5)", 4), ("max('torque J2' - 0.4, 0)", 5), ("exp(-1.5*row)", 4),
    ("'torque J2'*cos(J2)", 4), ("J5 - max(min(J5, 0.7), -0.7)", 6), ("sin(J2)*abs(sin(J2))", 6),
    ("exp(-1.2*J2)*tanh(2*J5 - 1)", 11), ("max(J2 - 0.3, 0)/(2.6 + J5)", 10), ("J2/(1 + 3*square(J2 - 0.4))", 12),
    ("tanh(2*(J2 - 0.4*J5))", 8), ("J5*abs(J5)*sqrt(2.4 - J2)", 9), ("exp(-4*square(J2 - 0.5)) + 0.7*tanh(3*J5)", 14),
    ("(J2 - max(min(J2, 1.0), 0.2))*atan(2*J5)", 11), ("(tanh(4*J2 - 2) + 1)*abs(J5 - 0.3)", 11),
    ("(J2 - 0.2)*(square(J2 - 0.2) - 1.2)", 7), ("(J2 - 0.3)*power(abs(J2 - 0.3), 0.7)", 7),
    ("sin(0.3*square(J2 - 2.8))", 7), ("(J2 + 0.2)/(0.3 + square(J2 - 0.6))*J5", 13),
    ("sin(2.5*J2) + 0.4*abs(J5 - 0.3)", 12), ("tanh(3*(sqrt(square(J2 - 0.4) + 1.5*square(J5 + 0.3)) - 1))", 17),
]  # fmt: skip


@pytest.mark.first(3)
@pytest.mark.parametrize(("law", "nodes"), [*BRIEF, *(pytest.param(*law, marks=pytest.mark.long) for law in LAWS)])
def test_a_curve_gets_its_law(law: str, nodes: int) -> None:
    problem = curve(law, 0.05)
    wanted = parse(law)
    found = laws_of(problem, wanted.inputs)
    best = max(found, key=lambda one: float(problem.nats(one.gain, one.complexity + 1)))
    assert best.complexity <= nodes
    assert set(best.program.inputs) == set(wanted.inputs)
    shapes = [p.evaluate(INPUTS.mapping())[0] for p in (best.program, wanted)]
    assert abs(np.corrcoef(shapes)[0, 1]) > 0.99


@pytest.mark.long
def test_two_inputs_that_a_third_is_multiplied_with_get_the_law_of_all() -> None:
    problem = curve("sin(2*J2)*'torque J2'*(row + 0.2)", 0.05)
    best = max(laws_of(problem, ("J2", "torque J2")), key=lambda one: one.gain)
    assert set(best.program.inputs) == {"J2", "torque J2", "row"}
    assert best.gain > 0.99
    alone = laws_of(curve("sin(2*J2)*'torque J2'", 0.3), ("J2", "torque J2"))
    assert all(set(law.program.inputs) <= {"J2", "torque J2"} for law in alone)


@pytest.mark.long
@pytest.mark.parametrize("last", ["0.8*abs('torque J2' - 0.3)", "0.7*sin(3*row)"])
def test_a_product_and_a_third_input_beside_it_are_founders(last: str) -> None:
    wanted = parse(f"sin(2*J2)*exp(0.8*J5) + {last}")
    problem = curve(str(wanted), 0.05)
    best = max(formulas_at(problem, 1, wanted.inputs, 0), key=lambda one: float(problem.nats(one.gain, one.complexity)))
    assert set(best.program.inputs) == set(wanted.inputs)
    assert best.gain > 0.99
    assert best.generation == 0


def test_a_formula_that_is_bred_has_its_generation() -> None:
    problem = curve("sin(2*J2)*exp(0.8*J5)", 0.05).only(1, ("J2", "J5"))
    population = Formulas(problem)
    population.add([parse("sin(2*J2)")])
    evolve_formulas(population, ("J2", "J5"), 1)
    assert {one.generation for one in population.found} == {0, 1}
    assert max(population.found, key=lambda one: one.gain).generation == 1


@pytest.mark.long
def test_of_more_inputs_a_law_takes_the_three_that_it_is_made_of() -> None:
    problem = curve("abs(J2 + 0.4)*'torque J2'*row", 0.05)
    best = max(laws_of(problem, NAMES), key=lambda one: one.gain)
    assert set(best.program.inputs) == {"J2", "torque J2", "row"}
    assert best.gain > 0.99


@pytest.mark.parametrize(
    ("text", "nodes"),
    [
        ("sin(2*J2)*exp(J5)", 7), ("exp(-4*square(J2 - 2))", 7), ("abs(exp(J2))", 5), ("square(tanh(4*(J2 - 2)))", 9),
        ("sin(2*abs(atan(J2)))", 10),
    ],
)  # fmt: skip
def test_a_function_of_a_function_costs_two_nodes(text: str, nodes: int) -> None:
    assert description_size(parse(text)) == nodes


@pytest.mark.parametrize(
    "seed", [1, 2, pytest.param(6, marks=pytest.mark.long), pytest.param(7, marks=pytest.mark.long)]
)
def test_of_equally_good_formulas_the_one_without_a_function_of_a_function_is_shorter(seed: int) -> None:
    """A line times a resonance is sin(2 atan(x) - b), too, up to a constant."""
    problem = curve("(J2 - 0.25)*reciprocal(0.28 + square(J2 - 0.8))", 0.1, seed)
    found = laws_of(problem, ("J2",))

    def nats(operators: set[str]) -> float:
        those = (one for one in found if operators <= {*one.program.operator_counts})
        return max(float(problem.nats(one.gain, one.complexity + 1)) for one in those)

    assert nats({"multiply", "reciprocal", "add", "square"}) > nats({"sin", "atan"})


@pytest.mark.long
def test_laws_are_one_term_and_short() -> None:
    found = laws_of(curve("sin(J2)*abs(J5)", 0.3), ("J2", "J5"))
    assert found
    assert [law.complexity for law in found] == sorted(law.complexity for law in found)
    for law, other in permutations(found, 2):
        no_longer = other.complexity <= law.complexity and length(other.program) <= length(law.program)
        assert not no_longer or other.gain < law.gain
    for law in found:
        assert len(law.program.outputs) == 1
        assert law.complexity <= LONGEST


@pytest.mark.long
def test_of_noise_no_law_saves_much() -> None:
    problem = curve("J2", 50.0, 3)
    found = laws_of(problem, ("J2", "J5"))
    assert max((float(problem.nats(law.gain, law.complexity + 1)) for law in found), default=0.0) < 5.0


@pytest.mark.long
def test_the_arguments_alone_decide_and_unknown_inputs_are_named() -> None:
    problem = curve("tanh(3*J5)", 0.1)
    first, again = (laws_of(problem, ("J5",)) for _ in range(2))
    assert [str(law.program) for law in first] == [str(law.program) for law in again]
    with pytest.raises(InputError, match="unknown 'J9'"):
        laws_of(problem, ("J9",))


def test_a_law_less_a_node_still_reads_an_input_and_is_fitted() -> None:
    problem, law = curve("square(tanh(3*J5))", 0.05).only(1, ("J5",)), parse("square(tanh(2*J5) - 0.1)")
    left = {str(program.with_constants([1.0] * len(program.constants))): program for program in shorter(law, problem)}
    assert all(program.inputs and program.complexity < law.complexity for program in left.values())
    assert "square(tanh(1*J5))" in left
    assert problem.targets.set_gain(left["square(tanh(1*J5))"].evaluate(problem.inputs.mapping()), 0)[0] > 0.99


@pytest.mark.parametrize("exponent", [-200, 200])
def test_a_formula_whose_spread_has_no_square_is_bred_from_as_any_other(exponent: int) -> None:
    """A steep exponential, which is one at one pose and nothing at the others, as is what is sought."""
    values = INPUTS.mapping()["J5"]
    peak = (values == (values.max() if exponent > 0 else values.min())).astype(float)
    there = regression(peak + 0.01 * np.random.default_rng(0).normal(size=90))
    targets = Targets(np.ones((1, 90)), there.cross, there.pull, there.energy, ("here",), 90)
    population = Formulas(SlotProblem(INPUTS, targets, parsimony=2.0))
    population.take(parse(f"exp({exponent}*J5)"))
    evolve_formulas(population, NAMES, 1)
    assert len(population.found) > 1
