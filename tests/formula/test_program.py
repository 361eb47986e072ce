"""Programs as objects: text, algebra, source, size."""

import numpy as np
import pytest
from latex_reading import read_latex

from gpmodel.errors import InputError
from gpmodel.formula.operators import LANGUAGE
from gpmodel.formula.parse import parse
from gpmodel.formula.printing import as_in_latex, inline, latex
from gpmodel.formula.program import Builder, Program
from gpmodel.formula.simplification import simplify

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
        ("add(J1)", "takes 2"),
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
