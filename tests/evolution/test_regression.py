"""Test `gp.regress`: links, solved coefficients, and the found formulas."""

import time
from itertools import count

import numpy as np
import pytest

from gpmodel.errors import InputError
from gpmodel.evolution.links import LINKS
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.regression import EXACT, Law, regression_front
from gpmodel.formula.expression import parse
from gpmodel.formula.program import Program

RNG = np.random.default_rng(3)
COLUMNS = {name: RNG.uniform(1.0, 3.0, 80) for name in "abc"}
INPUTS = Inputs(tuple(COLUMNS), np.array(list(COLUMNS.values())))
BY_NAME = {"quotient" if link.quotient else link.operator: link for link in LINKS}

LAWS = {
    "powers": "7*a*b**2/c",
    "logarithm": "exp(a*b)*sqrt(c)",
    "identity": "3 + 2*sin(a) - 5*b*c",
    "quotient": "(a + b)/(1 + 2*a*b)",
    "reciprocal": "1/(1/a + b/c)",
    "square": "sqrt(a**2 + b**2 + 0.25)",
}


def values_of(text: str) -> np.ndarray:
    return parse(text).evaluate(COLUMNS)[0]


def regress(response: np.ndarray, seed: int, steps: int) -> Law:
    """The law of least description length, after so many looks at the clock."""
    laws = regression_front(INPUTS, response, np.random.default_rng(seed), steps, clock=count().__next__)
    return min(laws, key=lambda law: law.nats)


def terms(*texts: str) -> list[Program]:
    return [parse(text) for text in texts]


@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_found_exactly_under_one_of_the_links(name: str) -> None:
    response = values_of(LAWS[name])
    law = regress(response, 0, 20_000)
    assert law.left < EXACT
    np.testing.assert_allclose(law.program.evaluate(COLUMNS)[0], response, rtol=1e-8)


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("origin_of_a", "unit", "offset"),
    [(0.0, 1.0, 1e6), (0.0, 1e-9, -1e-3), (0.0, 1e9, 1e15), (1e5, 1.0, 0.0), (2010.0, 1.0, 0.0), (-1.7e9, 1.0, 1e6)],
)
@pytest.mark.parametrize("name", ["powers", pytest.param("reciprocal", marks=pytest.mark.long)])
def test_a_noisy_law_depends_neither_on_the_origin_of_a_column_nor_on_the_unit_of_the_response(
    name: str, origin_of_a: float, unit: float, offset: float
) -> None:
    clean, rng = values_of(LAWS[name]), np.random.default_rng(1)
    noisy = clean + 0.05 * clean.std() * rng.normal(size=80)
    shifted = Inputs(INPUTS.names, INPUTS.values + np.array([[origin_of_a], [0.0], [0.0]]))
    fits = []
    for inputs, response in (INPUTS, noisy), (shifted, unit * noisy + offset):
        found = regression_front(inputs, response, np.random.default_rng(0), 20, clock=count().__next__)
        law = min(found, key=lambda law: law.nats)
        fits.append(law.program.evaluate(inputs.mapping())[0])
    plain, other = fits[0], (fits[1] - offset) / unit
    assert np.abs(other - plain).max() < 1e-3 * clean.std()


@pytest.mark.parametrize("unit", [1e-30, 1e30])
def test_a_law_is_found_in_any_unit_of_the_response(unit: float) -> None:
    response = unit * values_of("3*a + b*c")
    law = regress(response, 0, 20_000)
    np.testing.assert_allclose(law.program.evaluate(COLUMNS)[0], response, rtol=1e-8)


@pytest.mark.long
def test_constants_of_a_noisy_law_are_those_that_fit_the_response_and_not_its_link() -> None:
    clean = values_of("1/(1/a + b/c)")
    noisy = clean + 0.05 * np.random.default_rng(5).normal(size=80)
    law = regress(noisy, 0, 60)
    best = np.linalg.lstsq(law.program.evaluate(COLUMNS).T, noisy, rcond=None)[0][0]
    assert best == pytest.approx(1.0, abs=1e-6)
    assert law.left < 0.1


@pytest.mark.long
def test_where_nothing_is_worth_its_price_the_law_is_the_mean() -> None:
    noise = 3.0 + np.random.default_rng(11).normal(size=80)
    law = regress(noise, 0, 60)
    assert law.program.inputs == ()
    assert law.left == pytest.approx(1.0)


@pytest.mark.long
def test_a_law_depends_on_the_seed_alone() -> None:
    noisy = values_of("a*sin(b) + c") + 0.1 * np.random.default_rng(1).normal(size=80)
    first, second = (regress(noisy, 4, 30) for _ in range(2))
    assert (first.program, first.left) == (second.program, second.left)


@pytest.mark.parametrize(
    ("link", "law", "above", "below"),
    [
        ("", "2*sin(a) + 3", ["sin(a)", "b", "exp(c)"], ()),
        ("log", "5*a**2/sqrt(b)*exp(-2*c)", ["c", "a*b"], ()),
        ("reciprocal", "1/(2*a + b/c)", ["a", "b/c", "c"], ()),
        ("square", "sqrt(3*a + 2*b)", ["a", "b", "c"], ()),
        ("quotient", "(1 + 2*a)/(1 - 0.1*b)", ["a", "c"], ["b", "c"]),
    ],
)
def test_coefficients_are_solved_and_terms_not_worth_their_price_left_out(
    link: str, law: str, above: list[str], below: list[str]
) -> None:
    response = values_of(law)
    found = BY_NAME[link].formula(terms(*above), COLUMNS, response, terms(*below))
    assert found is not None
    np.testing.assert_allclose(found.evaluate(COLUMNS)[0], response, rtol=1e-10)
    assert set(found.inputs) == set(parse(law).inputs)


@pytest.mark.parametrize(
    ("law", "above"),
    [
        pytest.param("3*cos(a)*b", ["log(cos(a))"], id="odd factors keep their sign"),
        pytest.param("2*exp(0.3*log(a))*b", [], id="what is not simple stays as it is solved"),
    ],
)
def test_exponents_are_solved(law: str, above: list[str]) -> None:
    response = values_of(law)
    found = BY_NAME["log"].formula(terms(*above), COLUMNS, response)
    assert found is not None
    np.testing.assert_allclose(found.evaluate(COLUMNS)[0], response, rtol=1e-10)


def test_an_exponent_near_a_simple_one_for_the_noise_becomes_it_and_keeps_the_sign() -> None:
    response = values_of("3*cos(a)*b**2/c")
    noisy = response + 0.01 * response.std() * np.random.default_rng(2).normal(size=80)
    found = BY_NAME["log"].formula(terms("log(cos(a))"), COLUMNS, noisy)
    assert found is not None
    assert len(found.constants) == 1
    np.testing.assert_allclose(found.evaluate(COLUMNS)[0], response, rtol=0.01)


@pytest.mark.parametrize("name", ["log", "reciprocal", "square"])
def test_weights_say_what_an_error_of_the_link_does_to_the_response(name: str) -> None:
    link, response = BY_NAME[name], values_of("a*b")
    moved = np.abs(1e-6 / (link.forward(response + 1e-6) - link.forward(response)))
    np.testing.assert_allclose(link.root_weights(response), moved / moved.max(), rtol=1e-4)


def test_nothing_is_solved_of_columns_that_are_no_numbers() -> None:
    assert BY_NAME[""].formula(terms("log(a - a)"), COLUMNS, values_of("a")) is None


def test_gains_under_a_link_are_those_of_weighted_least_squares_beside_the_terms_of_every_sum() -> None:
    link, response = BY_NAME["log"], values_of("0.02*a*b/c + 0.1/(1 + a)")
    root, there = link.root_weights(response), link.forward(response)
    always = np.stack([term.evaluate(COLUMNS)[0] for term in link.always(COLUMNS)], axis=1)

    def left(table: np.ndarray) -> float:
        rest = root * there - root[:, None] * table @ np.linalg.lstsq(root[:, None] * table, root * there)[0]
        return float(rest @ rest)

    shape = values_of("sin(a*c)")
    gain = link.targets(COLUMNS, response).gains(shape[None])[0]
    assert gain == pytest.approx(1.0 - left(np.column_stack([always, shape])) / left(always), rel=1e-6)


@pytest.mark.parametrize("response", [np.ones(80), np.full(80, np.nan), np.ones(2)])
def test_a_response_without_anything_to_explain_is_one_clear_line(response: np.ndarray) -> None:
    with pytest.raises(InputError, match="response") as caught:
        regression_front(INPUTS, response, np.random.default_rng(0), 1.0)
    assert "\n" not in str(caught.value)


@pytest.mark.long
def test_a_response_near_its_pole_at_one_point_has_its_law() -> None:
    """The weights of the second solution of a quotient differ by 1e20 there."""
    x = np.random.default_rng(0).uniform(1.0, 2.0, 50)
    away = x - x.mean()
    response = 1.0 / (1.0 - (1.0 - 1e-10) / away.max() * away)
    found = regression_front(Inputs(("x",), x[None]), response, np.random.default_rng(1), 1.0, time.process_time)
    assert found[-1].left < 1e-20


@pytest.mark.first(2)
@pytest.mark.parametrize(
    "table",
    [
        pytest.param(np.ones((1, 9)), id="constant"),
        pytest.param(np.vstack([RNG.uniform(1, 3, 60), np.zeros(60)]), id="one input is zero"),
        pytest.param(RNG.normal(size=(200, 60)), id="more inputs than rows"),
        pytest.param(RNG.uniform(1, 3, (9, 5)), id="nine positive inputs of five rows"),
        pytest.param(1e90 * RNG.uniform(1, 3, (2, 60)), id="squares of squares overflow"),
    ],
)
def test_any_table_ends_in_a_law_without_a_warning(table: np.ndarray) -> None:
    inputs = Inputs(tuple(f"x{k}" for k in range(len(table))), table)
    response = np.abs(table[0]).max() * np.linspace(1.0, 2.0, table.shape[1]) ** 3
    found = regression_front(inputs, response, np.random.default_rng(0), 100.0, clock=count().__next__)
    assert np.isfinite([law.left for law in found]).all()


@pytest.mark.long
@pytest.mark.parametrize(("inputs", "rows"), [(3, 20_000), (1, 3000), (2, 300), (200, 60), (4, 200)])
def test_the_limit_of_time_holds_on_any_table(inputs: int, rows: int) -> None:
    table = Inputs(tuple(f"x{k}" for k in range(inputs)), np.random.default_rng(1).uniform(1, 3, (inputs, rows)))
    noise = 0.1 * np.random.default_rng(2).normal(size=rows)
    response = np.sin(table.values[0]) * table.values[-1] + noise
    regression_front(INPUTS, values_of("a") + 0.1 * noise[:1], np.random.default_rng(0), 0.5)  # compiles the loops
    began = time.process_time()
    regression_front(table, response, np.random.default_rng(0), 2.0, clock=time.process_time)
    assert time.process_time() - began < 3.0


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_a_formula_of_noisy_friction_has_no_pole_between_the_rows(seed: int) -> None:
    rng = np.random.default_rng([7, 23])
    speed = rng.uniform(-1, 1, 200), rng.uniform(-1, 1, 2000)
    here, there = ((2 + 1.5 * np.exp(-((v / 0.2) ** 2))) * np.tanh(v / 0.01) + 0.8 * v for v in speed)
    noisy, inputs = here + 0.02 * here.std() * rng.normal(size=200), Inputs(("v",), speed[0][None])
    found = regression_front(inputs, noisy, np.random.default_rng(seed), 5.0, clock=time.process_time)
    law = min(found, key=lambda law: law.nats)
    assert np.abs(law.program.evaluate({"v": speed[1]})[0] - there).max() < here.std()


def test_no_formula_of_a_short_table_has_a_pole_between_the_rows() -> None:
    rng = np.random.default_rng(1)
    rows, between = rng.uniform(-3.0, 3.0, (2, 40)), rng.uniform(-3.0, 3.0, (2, 100_000))
    inside = (np.abs(between) <= np.abs(rows).max(axis=1, keepdims=True)).all(axis=0)
    response = 8.0 / (2.0 + np.square(rows).sum(axis=0)) + 0.02 * rng.normal(size=40)
    table = Inputs(("a", "b"), rows)
    found = regression_front(table, response, np.random.default_rng(1), 15, clock=count().__next__)
    columns = dict(zip("ab", between[:, inside], strict=True))
    assert max(np.abs(law.program.evaluate(columns)).max() for law in found) < 10.0 * response.max()


@pytest.mark.long
def test_constants_of_a_long_table_are_those_of_all_rows() -> None:
    a = np.random.default_rng(4).uniform(1, 3, 5000)
    noise = 0.1 * np.random.default_rng(5).normal(size=5000)
    response = 3.0 + 2.0 * np.sin(2.0 * a) + noise
    found = regression_front(Inputs(("a",), a[None]), response, np.random.default_rng(0), 3.0, time.process_time)
    law = min(found, key=lambda law: law.nats)
    assert np.mean(np.square(response - law.program.evaluate({"a": a})[0])) < 1.001 * np.mean(np.square(noise))
