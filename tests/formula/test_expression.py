"""Shapes written as text: arithmetic over known columns, and nothing but that."""

import numpy as np
import pytest
from effect_cases import bare, mechanism
from hypothesis import given
from hypothesis import strategies as st

from gpmodel.errors import GpModelError, InputError
from gpmodel.formula.expression import ONE, Expression
from gpmodel.formula.operators import BY_NAME
from gpmodel.model.states import states_of

STATES = states_of(mechanism("irb6400r"), bare("irb6400r", 9))

MEANINGS = {
    "1": lambda s: np.ones(9),
    "sin(2*J4)": lambda s: np.sin(2 * s["J4"]),
    "-J1 + +J2": lambda s: s["J2"] - s["J1"],
    "J1 - J2 - J3": lambda s: (s["J1"] - s["J2"]) - s["J3"],
    "J1 - (J2 - J3)": lambda s: s["J1"] - (s["J2"] - s["J3"]),
    "J1 / J2 / J3": lambda s: s["J1"] / s["J2"] / s["J3"],
    "J1**2 % 0.5": lambda s: np.mod(s["J1"] ** 2, 0.5),
    "(torque_J2/100)**3": lambda s: (s["torque_J2"] / 100) ** 3,
    "sign(torque_J3)": lambda s: np.sign(s["torque_J3"]),
    "step(row - 4.5)": lambda s: (s["row"] > 4.5) * 1.0,
    "exp(-row/3)*cos(J5)": lambda s: np.exp(-s["row"] / 3) * np.cos(s["J5"]),
    "tanh(J4*1e1)": lambda s: np.tanh(10 * s["J4"]),
    "abs(J2)": lambda s: np.abs(s["J2"]),
    "row**0.5": lambda s: np.sqrt(s["row"]),
    "row**-1 + 2**J1": lambda s: 1 / s["row"] + 2 ** s["J1"],
    "'J1' + (not J2)": lambda s: s["J1"] + (s["J2"] == 0),
    "lift = sin(J2); lift*lift": lambda s: np.sin(s["J2"]) ** 2,
    "max(J1, temperature)": lambda s: np.maximum(s["J1"], s["temperature"]),
}
REFUSED = (
    "__import__('os').system('true')", "J1.__class__", "[J1 for J1 in ()]", "J1 if J2 else J3", "lambda: 1", "J1 < J2",
    "J1 and J2", "None", "J1[0]", "open(J1)", "sin(J1, out=J2)", "eval(J1)", "J1 @ J2", "J1 // J2", "~J1",
    "(J1, J2)", "(y := J1)", "f'{J1}'", "*J1", "sin(*J1)", "J1 =", "", "1 +", "J1\nJ2", "import os", "2j",
    "sin(J1, J2)", "max(J1)", "1e999", "9" * 400, "J1\0", "(" * 300 + "J1" + ")" * 300,
)  # fmt: skip


@pytest.mark.parametrize("text", MEANINGS)
def test_text_means_what_it_says(text: str) -> None:
    np.testing.assert_allclose(Expression(text)(STATES), MEANINGS[text](STATES), rtol=1e-14)
    assert str(Expression(text)) == text


@pytest.mark.parametrize("text", REFUSED)
def test_anything_but_arithmetic_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="basis"):
        Expression(text)


@given(st.text(max_size=30))
def test_no_text_does_anything_but_evaluate_to_numbers_or_be_refused(text: str) -> None:
    try:
        value = Expression(text)(STATES)
    except GpModelError:
        return
    assert value.shape == (9,)


@given(st.from_regex(r"[A-Za-z_][A-Za-z_0-9]{0,6}\([A-Za-z_0-9., =*]{0,6}\)", fullmatch=True))
def test_only_listed_functions_can_be_called(text: str) -> None:
    function = text.split("(")[0]
    if function not in BY_NAME:
        with pytest.raises(InputError):
            Expression(text)


def test_inputs_are_the_columns_read_each_once() -> None:
    assert sorted(Expression("sin(J4)*J10 + J4*torque_J1").inputs) == ["J10", "J4", "torque_J1"]
    assert ONE.inputs == ()


def test_a_name_is_matched_whole() -> None:
    assert Expression("J10").inputs == ("J10",)
    with pytest.raises(InputError, match="'J10' is not known here"):
        Expression("J10")(STATES)


def test_a_column_may_carry_the_name_of_no_function() -> None:
    assert Expression("sin(sine)").inputs == ("sine",)


@pytest.mark.parametrize(
    ("text", "count"),
    [("J2", 1), ("torque_J2/3030.0", 1), ("(row - 43.9)/27.1", 1), ("tanh(2*J2)", 2), ("tanh(2*(torque_J2/3030.0))", 2),
     ("1/J2", 3), ("J1 - J2", 3), ("sin(J1)/2 - 1", 6)],
)  # fmt: skip
def test_an_input_with_its_own_origin_and_scale_is_as_long_as_an_input(text: str, count: int) -> None:
    assert Expression(text).length == count


@pytest.mark.parametrize(
    ("text", "call"),
    [("sin(2*J4)", ("sin", "2*J4")), ("cos( 2 * J4 )", ("cos", "2*J4")), ("sin(J1) + 1", ("", "")), ("J1", ("", ""))],
)
def test_a_call_is_known_by_its_function_and_argument_however_it_is_spaced(text: str, call: tuple[str, str]) -> None:
    assert Expression(text).call == call


def test_equal_parts_are_worked_out_once() -> None:
    assert Expression("sin(J1)*sin(J1)").program.operator_counts == {"sin": 1, "multiply": 1}
    assert Expression("sin(J1)*sin(J1)").length == 5
