"""Test programs as objects: text, algebra, source, size."""

import gc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from effect_cases import bare, mechanism
from hypothesis import given
from hypothesis import strategies as st
from latex_reading import read_latex

from gpmodel.errors import GpModelError, InputError
from gpmodel.formula.algebra import simplify
from gpmodel.formula.expression import ONE, Expression, parse
from gpmodel.formula.operators import ARITHMETIC, BY_NAME, LANGUAGE, SETS, TABLE_CONSTANTS, Operator, operator_set
from gpmodel.formula.printing import as_in_latex, inline, latex
from gpmodel.formula.program import Builder, Program
from gpmodel.model.states import states_of

RNG = np.random.default_rng(5)
INPUTS = {name: RNG.uniform(0.1, 2.0, 30) for name in ("J1", "J2", "oil temp", "lambda", "v1")}

TEXTS = [
    "sin(2*J1)",
    "J1 - (J2 - 3) - 1",
    "J1/(J2/J1)/J2",
    "t = J1*J1; t*t + sqrt(t), J2",
    "-J1 + -2.5*'oil temp'",
    "max(abs('lambda'), 0.5) % J2",
    "(not J1) + (not (J1 - J1))",
    "J2**3 + exp(-(J1 - 1.25)**2)",
    "v1 + sin(J1*J1)*(J1*J1)",
    "tanh(1e-06*J1) + 123456789.5",
    "J1, J1, 0",
    "J1**0.5 + 2**-J2 + sign(J1)*step(J2 - 1)",
]


@pytest.mark.parametrize("text", TEXTS)
def test_text_reads_back_as_the_same_program(text: str) -> None:
    program = parse(text)
    again = parse(str(program))
    assert again == program
    np.testing.assert_array_equal(again.evaluate(INPUTS), program.evaluate(INPUTS))


@pytest.mark.parametrize("text", TEXTS)
def test_simplified_and_source_evaluate_alike(text: str) -> None:
    program = parse(text)
    simpler = simplify(program)
    assert sum(simpler.operator_counts.values()) <= sum(program.operator_counts.values())
    np.testing.assert_allclose(simpler.evaluate(INPUTS), program.evaluate(INPUTS), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(by_source(program, INPUTS), program.evaluate(INPUTS)[0])


def by_source(program: Program, inputs: dict[str, np.ndarray]) -> np.ndarray:
    """The first output by its source in Python."""
    source = inline(program, "numpy", {name: f"inputs[{name!r}]" for name in inputs})
    return np.broadcast_to(eval(source, {"np": np, "inputs": inputs}), 30)


@pytest.mark.parametrize("operator", LANGUAGE, ids=lambda operator: operator.name)
def test_every_operator_prints_parses_and_has_source_and_latex(operator) -> None:
    builder = Builder()
    arguments = [builder.input("J1"), builder.input("J2")][: operator.arity]
    program = builder.program([builder.apply(operator.name, *arguments)])
    assert parse(str(program)) == program
    scaled = {name: column / 4.0 for name, column in INPUTS.items()}
    expected = operator.function(*[scaled[name] for name in ("J1", "J2")][: operator.arity])
    np.testing.assert_array_equal(by_source(program, scaled), expected)
    np.testing.assert_allclose(simplify(program).evaluate(scaled)[0], expected, rtol=1e-12)
    again = parse(read_latex(latex(program)))
    np.testing.assert_allclose(again.evaluate(scaled)[0], expected, rtol=1e-12)
    np.testing.assert_allclose(as_in_latex(program).evaluate(scaled)[0], expected, rtol=1e-12)


def test_effective_code_only() -> None:
    builder = Builder()
    builder.apply("sin", builder.input("dead"))
    root = builder.apply("multiply", builder.input("J1"), builder.input("J1"))
    program = builder.program([root, root])
    assert program.inputs == ("J1",)
    assert program.input_counts == {"J1": 2}
    assert program.operator_counts == {"multiply": 1}
    assert program.complexity == 3
    assert program.select([1]).outputs == (1,)


def test_shared_parts_count_once() -> None:
    shared = parse("t = sin(J1*J2); t*t + t")
    assert shared.operator_counts == {"multiply": 2, "sin": 1, "add": 1}
    assert shared.complexity == 6


def test_inputs_are_replaced_by_programs_and_written_out() -> None:
    program = parse("t = sin(a); t*t + b").with_inputs({"a": parse("(J1 - 3)/2")})
    assert str(program) == "v1 = sin((J1 - 3)/2); v1*v1 + b"
    assert program.written_out() == "sin((J1 - 3)/2)*sin((J1 - 3)/2) + b"


def test_constants_are_replaced_in_order() -> None:
    program = parse("3*J1 + 0.5")
    assert program.constants == (3.0, 0.5)
    assert str(program.with_constants([2.0, -1.0])) == "2*J1 + (-1)"


def test_simplification_shortens() -> None:
    assert str(simplify(parse("sin(J1)**2 + cos(J1)**2"))) == "1"
    assert simplify(parse("J1*J1*J1/(1/J1)")).complexity == 3


def test_simplification_works_numbers_out_and_leaves_neutral_elements_out() -> None:
    text = "v1 = J1 + 0; v2 = square(0.5)*4; v1*v2, v1 + (0.25*v1 + 0), sin(v1*v1) - 0"
    assert str(simplify(parse(text))) == "J1, 1.25*J1, sin(square(J1))"
    longer_by_algebra = "v1 = 0 + J1; v2 = atan(0.5)*2; v1*v2*sin(atan(J2)*v2 + v1)"
    assert "0 + J1" not in str(simplify(parse(longer_by_algebra)))
    assert "atan(0.5)" not in str(simplify(parse(longer_by_algebra)))


def test_latex_rounds_numbers_and_keeps_whole_ones() -> None:
    assert latex(parse("0.000999999666666867*J1 + 2*J2")) == "0.001 J_{1} + 2 J_{2}"


def nested(levels: int) -> Program:
    """Every level uses the one before twice: written out in full it has 2**levels leaves."""
    steps = [f"v{k} = sin(v{k - 1} + 0.1)*atan(v{k - 1}*J2 + 0)" for k in range(2, levels + 1)]
    return parse("; ".join(["v1 = J1*J2", *steps, f"v{levels}, J2 + v{levels}*0"]))


@pytest.mark.long
@pytest.mark.parametrize("levels", [1, 8, 40])
def test_algebra_on_a_long_program_ends_and_keeps_its_values(levels: int) -> None:
    program = nested(levels)
    simpler = simplify(program)
    assert simpler.complexity < program.complexity
    np.testing.assert_allclose(simpler.evaluate(INPUTS), program.evaluate(INPUTS), rtol=1e-9, atol=1e-300)
    written = latex(program)
    assert len(written) < 200 * levels
    assert ("v_{2} = " in written) == (levels > 1)


@pytest.mark.long
@pytest.mark.parametrize(
    "text",
    [
        "v1 = cos(J1 + 2.026) + 2.026; cos(atan(cos(v1)*v1))",
        "v1 = cos(J1 - J2); v2 = sin(v1); sin(atan((v2 - v1)*v1 + v2))",
        "v1 = tan(J1) + square(tan(J1 + J2)/(sin(2*J2) + 1)/(cos(2*J1) + 1)); square(square(v1)/(atan(2*J2) + 1) + 1)",
    ],
)
def test_algebra_on_functions_of_functions_of_angles_ends_and_keeps_their_values(text: str) -> None:
    program = parse(text)
    simpler = simplify(program)
    assert sum(simpler.operator_counts.values()) <= sum(program.operator_counts.values())
    np.testing.assert_allclose(simpler.evaluate(INPUTS), program.evaluate(INPUTS), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("sinn(J1)", "sinn"),
        ("J1 +", "column"),
        ("__import__('os')", "__import__"),
        ("J1.real", "J1.real"),
        ("add(J1)", "expected 2"),
        ("", "expression"),
        ("J1 @ J2", "J1 @ J2"),
    ],
)
def test_text_that_is_no_program_is_one_clear_line(text: str, named: str) -> None:
    with pytest.raises(InputError, match=named) as caught:
        parse(text)
    assert "\n" not in str(caught.value)


def test_a_missing_input_is_named_with_those_available() -> None:
    with pytest.raises(InputError, match="no input 'J9', available: J1"):
        parse("J9").evaluate({"J1": np.ones(3)})


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
    with pytest.raises(InputError, match="'J10' is neither in the table nor computed"):
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


class Round:
    """Found by the collector alone, which runs code here and lets other threads in."""

    def __init__(self) -> None:
        self.own = self

    def __del__(self) -> None:
        for _ in range(50):
            pass


@pytest.mark.long
def test_texts_are_parsed_in_many_threads_at_once() -> None:
    def parsed(thread: int) -> set[str]:
        found = set()
        for _ in range(300):
            Round()
            found.add(str(parse("(J1 - 1)*sin(J2*2 + 3)")))
        return found

    before = gc.get_threshold()
    gc.set_threshold(5, 2, 2)
    try:
        with ThreadPoolExecutor(6) as pool:
            texts = list(pool.map(parsed, range(6)))
    finally:
        gc.set_threshold(*before)
    assert texts == [{str(parse("(J1 - 1)*sin(J2*2 + 3)"))}] * 6
