"""Test the signs in printed formulas."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpmodel.formula.expression import parse
from gpmodel.selection.programs import with_plain_signs


@pytest.mark.parametrize(
    ("written", "plain"),
    [
        ("J1 - (-1.5)", "J1 + 1.5"), ("J1 + (-1.5)", "J1 - 1.5"), ("(-1.5) + J1", "J1 - 1.5"),
        ("J1 + (-0.4)*J2", "J1 - 0.4*J2"), ("J1 - (-0.4)*J2", "J1 + 0.4*J2"), ("J1 - 2", "J1 - 2"),
        ("(-2)*J1 + (-3)*J2", "(-2)*J1 - 3*J2"), ("tanh(3*(J1 - (-0.2)))", "tanh(3*(J1 + 0.2))"),
        ("(-2)*J1 + J2", "J2 - 2*J1"),
    ],
)  # fmt: skip
def test_signs_are_resolved(written: str, plain: str) -> None:
    assert with_plain_signs(parse(written)).written_out() == plain


@given(st.lists(st.floats(-3, 3).map(lambda c: round(c, 2)), min_size=3, max_size=3))
def test_values_and_size_stay(numbers: list[float]) -> None:
    a, b, c = numbers
    program = parse(f"sin(({a})*J1 + ({b})*J2) - (({c}) + J1) - (({a}) - J2)")
    columns = {"J1": np.linspace(-1.0, 2.0, 7), "J2": np.linspace(0.5, -3.0, 7)}
    plain = with_plain_signs(program)
    np.testing.assert_allclose(plain.evaluate(columns), program.evaluate(columns), rtol=1e-12, atol=1e-12)
    assert plain.complexity == program.complexity
