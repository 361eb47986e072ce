"""Test the least squares fit of constants."""

import numpy as np
import pytest

from gpmodel.evolution.constants import polish
from gpmodel.evolution.projection import regression
from gpmodel.formula.expression import parse

RNG = np.random.default_rng(3)
INPUTS = {"a": RNG.uniform(-2, 2, 120), "b": RNG.uniform(0.5, 2, 120)}

PROGRAMS = [
    "sin(1.7*a + 0.3)",
    "exp(-((a - 0.4)/0.7)**2), 0.4*b",
    "t = a*2.5; tanh(t)*t, max(t, 0.1)",
    "a, b",
    "sqrt(b + 3.5)/(b - 4.5) + log(b*0.2) + atan(a % 0.9)",
]


@pytest.mark.parametrize(
    ("truth", "start"),
    [
        ("3*sin(1.7*a + 0.3)", "sin(1.4*a + 0.1)"),
        ("exp(-((a - 0.4)/0.7)**2)", "exp(-((a - 0.1)/1.3)**2)"),
        ("tanh(3*a)", "tanh(1.5*a)"),
        ("max(a - 0.8, 0) + min(a + 0.8, 0)", "max(a - 0.5, 0) + min(a + 0.55, 0)"),
        ("exp(-b/0.3)", "exp(-b/0.9)"),
    ],
)
def test_planted_constants_are_recovered(truth: str, start: str) -> None:
    response = parse(truth).evaluate(INPUTS)[0]
    program, gain = polish(parse(start), regression(response), 0, INPUTS, held=(0.0, -1.0), steps=60)
    assert gain > 1.0 - 1e-9
    values = program.evaluate(INPUTS)[0]
    assert abs(np.corrcoef(values, response)[0, 1]) > 1.0 - 1e-9


@pytest.mark.parametrize("text", PROGRAMS)
def test_polishing_never_loses_and_held_constants_stay(text: str) -> None:
    program = parse(text)
    targets = regression(RNG.normal(size=120) + INPUTS["a"] ** 2)
    before, _ = targets.set_gain(program.evaluate(INPUTS), 0)
    gain = polish(program, targets, 0, INPUTS)[1]
    assert gain >= before
    same, gain = polish(program, targets, 0, INPUTS, held=program.constants)
    assert same == program
    assert gain == pytest.approx(before)
