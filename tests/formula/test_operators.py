"""Operators: the table of the thesis, the named subsets, and the derivatives."""

import numpy as np
import pytest

from gpmodel.errors import InputError
from gpmodel.formula.operators import ARITHMETIC, BY_NAME, LANGUAGE, SETS, TABLE_CONSTANTS, Operator, operator_set

TABLE_5_1 = {
    "add": 3, "subtract": 4, "multiply": 5, "divide": 6, "modulo": 7, "min": 8, "max": 9, "abs": 10,
    "square": 11, "sqrt": 12, "not": 13, "sin": 14, "cos": 15, "tan": 16, "atan": 17,
}  # fmt: skip


def test_op_codes_are_those_of_table_5_1() -> None:
    assert {name: BY_NAME[name].code for name in SETS["thesis"]} == TABLE_5_1
    assert all(BY_NAME[name].arity == (2 if code < 10 else 1) for name, code in TABLE_5_1.items())
    assert TABLE_CONSTANTS == (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)


def test_codes_and_names_are_unique() -> None:
    assert len({operator.code for operator in ARITHMETIC}) == len(ARITHMETIC)
    assert len(BY_NAME) == len(LANGUAGE)


@pytest.mark.parametrize("operator", LANGUAGE, ids=lambda operator: operator.name)
def test_derivatives_agree_with_finite_differences(operator: Operator) -> None:
    rng = np.random.default_rng(1)
    arguments = [rng.uniform(0.15, 0.85, 50) for _ in range(operator.arity)]
    step = 1e-6
    for place, found in enumerate(operator.derivatives(*arguments)):
        ahead, behind = ([a + sign * step * (k == place) for k, a in enumerate(arguments)] for sign in (1, -1))
        expected = (operator.function(*ahead) - operator.function(*behind)) / (2 * step)
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("name", SETS["smooth"])
def test_smooth_operators_have_a_continuous_derivative(name: str) -> None:
    operator = BY_NAME[name]
    line = np.linspace(-4.0, 4.0, 8001)
    arguments = [line] if operator.arity == 1 else [line, line[::-1].copy()]
    for derivative in operator.derivatives(*arguments):
        assert np.all(np.isfinite(derivative))
        assert np.abs(np.diff(derivative)).max() < 0.01


@pytest.mark.parametrize("name", ["abs", "max", "min", "sqrt", "divide", "tan", "modulo", "not"])
def test_smooth_leaves_out_what_has_a_kink_or_a_pole(name: str) -> None:
    assert name not in SETS["smooth"]


def test_choices_that_the_thesis_leaves_open() -> None:
    a = np.array([-4.0, 0.0, 2.5])
    np.testing.assert_array_equal(BY_NAME["sqrt"].function(a), np.sqrt(np.abs(a)))
    np.testing.assert_array_equal(BY_NAME["not"].function(a), [0.0, 1.0, 0.0])
    np.testing.assert_allclose(BY_NAME["modulo"].function(a, np.full(3, -3.0)), [-1.0, 0.0, -0.5])
    with np.errstate(all="ignore"):
        assert BY_NAME["divide"].function(np.ones(1), np.zeros(1))[0] == np.inf
        assert np.isnan(BY_NAME["min"].function(np.array([np.nan]), np.ones(1))[0])


def test_a_set_can_be_named_or_listed() -> None:
    assert [operator.name for operator in operator_set("sin, add")] == ["add", "sin"]
    assert operator_set(SETS["smooth"]) == operator_set("smooth")


@pytest.mark.parametrize("names", ["thesi", "add,sine", "add,power", ()])
def test_an_unknown_or_empty_set_is_one_clear_line(names: str) -> None:
    with pytest.raises(InputError, match="operators: ") as caught:
        operator_set(names)
    assert "\n" not in str(caught.value)
