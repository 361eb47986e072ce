"""Test that a program is shortened by one node, and that simple constants are recognised."""

import numpy as np
import pytest

from gpmodel.evolution.memetic import Formulas
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.shorter import shorter_forms
from gpmodel.formula.expression import parse

X = np.random.default_rng(2).uniform(-2.0, 2.0, (2, 50))
COLUMNS = {"x": X[0], "y": X[1]}


@pytest.mark.parametrize(
    ("long", "short"),
    [
        ("x - 0.002", "x"),
        ("0.998*x", "x"),
        ("y*sin(x + 1.5708)", "cos(x)*y"),
        ("sin(2*(x - 1.57))", "cos(2*x)"),
        ("cos(x - 1.57)", "sin(x)"),
        ("sin((-0.99)*x + y)", "sin(y - x)"),
        ("sin(y + (-0.99)*x)", "sin(y - x)"),
        ("sin(y - (-0.99)*x)", "sin(y + x)"),
        ("(tanh(2*(x - 0.3)) + 1)*y", "logistic(4*(x - 0.3))*y"),
        ("(tanh(2*x) - 1)*y", "logistic((-4)*x)*y"),
        ("(1 - tanh(2*x))*y", "logistic((-4)*x)*y"),
        ("power(abs(x - 0.3), 1.98)", "square(x - 0.3)"),
        ("x*power(abs(x), 0.99)", "x*abs(x)"),
        ("(x - 0.301)*reciprocal(2 + square(x - 0.3))", "v = x - 0.3; v*reciprocal(2 + square(v))"),
    ],
)
def test_a_constant_that_needs_no_writing_goes(long: str, short: str) -> None:
    wanted = parse(short).evaluate(COLUMNS)[0]
    found = [one for one in shorter_forms(parse(long)) if np.allclose(one.evaluate(COLUMNS)[0], wanted)]
    assert min(one.complexity for one in found) == parse(short).complexity


@pytest.mark.parametrize("text", ["sin(2*x + 1)*tanh(3*y) - 0.5", "power(abs(x), 3) + min(y, 0.2)", "x", "1 - tanh(x)"])
def test_every_form_is_shorter_and_reads_an_input(text: str) -> None:
    program = parse(text)
    assert all(one.inputs and one.complexity < program.complexity for one in shorter_forms(program))


def test_of_programs_of_one_column_the_shortest_stays() -> None:
    population = Formulas(SlotProblem(Inputs(("x", "y"), X), regression(X[0]), parsimony=2.0))
    for text in ("x + 0.3*x", "2*x", "x", "1.5*x", "y"):
        population.take(parse(text))
    assert [str(one.program) for one in population.found] == ["x", "y"]
