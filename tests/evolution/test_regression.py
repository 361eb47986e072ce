"""Laws of a response: what a link makes a sum of, how coefficients are solved, and what is found."""

from itertools import count

import numpy as np
import pytest
from gpmodel.evolution.island import BUDGET, EXACT
from gpmodel.evolution.linked_problem import PRICE, LinkedProblem
from gpmodel.evolution.linked_solution import solved
from gpmodel.evolution.linked_terms import climbed_terms

from gpmodel.errors import InputError
from gpmodel.evolution.building_blocks import Vocabulary
from gpmodel.evolution.engine import values
from gpmodel.evolution.generations import Generations
from gpmodel.evolution.links import LINKS, Link, LinkTerm
from gpmodel.evolution.problems import Inputs
from gpmodel.evolution.regression import SEQUENCES, Law, regression_front
from gpmodel.evolution.settings import Settings
from gpmodel.formula.operators import operator_set
from gpmodel.formula.parse import parse

RNG = np.random.default_rng(3)
COLUMNS = {name: RNG.uniform(1.0, 3.0, 80) for name in "abc"}
INPUTS = Inputs(tuple(COLUMNS), np.array(list(COLUMNS.values())))
BY_NAME = {link.name: link for link in LINKS}

LAWS = {
    "powers": "7*a*b**2/c",
    "logarithm": "exp(a*b)*sqrt(c)",
    "identity": "3 + 2*sin(a) - 5*b*c",
    "quotient": "(a + b)/(1 + 2*a*b)",
    "reciprocal": "1/(1/a + b/c)",
    "square": "sqrt(a**2 + b**2 + 0.25)",
    "sine": "asin(0.3*sin(a*b))",
}


def values_of(text: str) -> np.ndarray:
    return parse(text).evaluate(COLUMNS)[0]


def regress(response: np.ndarray, seed: int, steps: int) -> Law:
    """The law of least description length, after so many looks at the clock."""
    laws = regression_front(INPUTS, response, np.random.default_rng(seed), steps, clock=count().__next__)
    return min(laws, key=lambda law: law.nats)


def terms(*texts: str, below: tuple[str, ...] = ()) -> list[LinkTerm]:
    return [*(LinkTerm(parse(text)) for text in texts), *(LinkTerm(parse(text), below=True) for text in below)]


@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_found_exactly_under_one_of_the_links(name: str) -> None:
    response = values_of(LAWS[name])
    law = regress(response, 0, 20_000)
    assert law.left < EXACT
    np.testing.assert_allclose(law.program.evaluate(COLUMNS)[0], response, rtol=1e-8)


@pytest.mark.parametrize("unit", [1e-30, 1e30])
def test_a_law_is_found_in_any_unit_of_the_response(unit: float) -> None:
    response = unit * values_of("3*a + b*c")
    law = regress(response, 0, 20_000)
    np.testing.assert_allclose(law.program.evaluate(COLUMNS)[0], response, rtol=1e-8)


def test_constants_of_a_noisy_law_are_those_that_fit_the_response_and_not_its_link() -> None:
    clean = values_of("1/(1/a + b/c)")
    noisy = clean + 0.05 * np.random.default_rng(5).normal(size=80)
    law = regress(noisy, 0, 60)
    best = np.linalg.lstsq(law.program.evaluate(COLUMNS).T, noisy, rcond=None)[0][0]
    assert best == pytest.approx(1.0, abs=1e-6)
    assert law.left < 0.1


def test_where_nothing_is_worth_its_price_a_law_is_short() -> None:
    noise = np.random.default_rng(11).normal(size=80)
    law = regress(noise, 0, 60)
    assert law.left > 0.5


@pytest.mark.long
def test_a_law_depends_on_the_seed_alone() -> None:
    noisy = values_of("a*sin(b) + c") + 0.1 * np.random.default_rng(1).normal(size=80)
    first, second = (regress(noisy, 4, 30) for _ in range(2))
    assert (first.program, first.left) == (second.program, second.left)


@pytest.mark.parametrize(
    ("link", "law", "above", "below"),
    [
        ("identity", "2*sin(a) + 3", ["1", "sin(a)", "b", "exp(c)"], ()),
        ("logarithm", "5*a**2/sqrt(b)*exp(-2*c)", ["1", "log(a)", "log(b)", "log(c)", "c"], ()),
        ("reciprocal", "1/(2*a + b/c)", ["1", "a", "b/c", "c"], ()),
        ("square", "sqrt(3*a + 2*b)", ["1", "a", "b", "c"], ()),
        ("sine", "asin(0.2*cos(a))", ["1", "cos(a)", "b"], ()),
        ("quotient", "(1 + 2*a)/(1 - 0.1*b)", ["1", "a", "c"], ("b", "c")),
    ],
)
def test_coefficients_are_solved_and_terms_not_worth_their_price_left_out(
    link: str, law: str, above: list[str], below: tuple[str, ...]
) -> None:
    response = values_of(law)
    found = solved(terms(*above, below=below), BY_NAME[link], COLUMNS, response, PRICE)
    assert found is not None
    np.testing.assert_allclose(found.evaluate(COLUMNS)[0], response, rtol=1e-10)
    assert set(found.inputs) == set(parse(law).inputs)


@pytest.mark.parametrize(
    ("law", "above"),
    [
        pytest.param("3*cos(a)*b", ["1", "log(cos(a))", "log(b)"], id="odd factors keep their sign"),
        pytest.param("2*exp(0.3*log(a))*b", ["1", "log(a)", "log(b)"], id="what is not simple stays as it is solved"),
    ],
)
def test_exponents_are_solved(law: str, above: list[str]) -> None:
    response = values_of(law)
    found = solved(terms(*above), BY_NAME["logarithm"], COLUMNS, response, PRICE)
    assert found is not None
    np.testing.assert_allclose(found.evaluate(COLUMNS)[0], response, rtol=1e-10)


def test_an_exponent_near_a_simple_one_for_the_noise_becomes_it_and_keeps_the_sign() -> None:
    response = values_of("3*cos(a)*b**2/c")
    noisy = response + 0.01 * response.std() * np.random.default_rng(2).normal(size=80)
    found = solved(terms("1", "log(cos(a))", "log(b)", "log(c)"), BY_NAME["weighted logarithm"], COLUMNS, noisy, PRICE)
    assert found is not None
    assert len(found.constants) == 1
    np.testing.assert_allclose(found.evaluate(COLUMNS)[0], response, rtol=0.01)


def test_weights_say_what_an_error_of_the_link_does_to_the_response() -> None:
    link, response = BY_NAME["weighted logarithm"], values_of("a*b")
    moved = np.exp(link.forward(response) + 1e-6) - response
    np.testing.assert_allclose(link.root_weights(response), moved / moved.max(), rtol=1e-5)


@pytest.mark.parametrize(
    ("link", "near", "below", "law"),
    [
        ("identity", ["sin(a)*b", "c"], (), "2*sin(a)*b + 3*b*c"),
        ("logarithm", ["a*b"], (), "exp(0.5*a*b/c)"),
        ("quotient", ["b"], ("a",), "(1 + 2*b)/(3 + a*c)"),
    ],
)
def test_terms_near_those_of_a_law_are_finished_by_single_edits(
    link: str, near: list[str], below: tuple[str, ...], law: str
) -> None:
    response = values_of(law)
    problem = LinkedProblem(INPUTS, response, BY_NAME[link])
    words = Vocabulary(INPUTS, operator_set("physics"), (1.0, 2.0))
    found = problem.law(climbed_terms(problem, terms(*near, below=below), words))
    assert found is not None
    np.testing.assert_allclose(found.evaluate(COLUMNS)[0], response, rtol=1e-6)


def test_nothing_is_solved_of_columns_that_are_no_numbers() -> None:
    assert solved(terms("log(a - a)"), BY_NAME["identity"], COLUMNS, values_of("a"), PRICE) is None


@pytest.mark.parametrize(
    "link", [link for link in LINKS if not (link.quotient or link.weighted)], ids=lambda link: link.name
)
def test_scores_are_those_of_least_squares_on_the_chosen_columns(link: Link) -> None:
    response = values_of("0.02*a*b/c + 0.1/(1 + a)")
    problem = LinkedProblem(INPUTS, response, link)
    run = Generations(problem, Settings(SEQUENCES, budget=BUDGET), np.random.default_rng(0))
    population, scores = run.start()
    there = link.forward(response)
    always = np.stack([term.column(COLUMNS, response) for term in problem.always], axis=1)
    rest = there - always @ np.linalg.lstsq(always, there, rcond=None)[0]
    used = 0
    for row in range(0, len(population), 2):
        outputs = population.program(row, run.layout).evaluate(COLUMNS)
        offered = np.concatenate([outputs[None], link.companions(outputs[None], response)], axis=1)[0]
        chosen = [k for k in range(len(offered)) if scores.chosen[row] >> k & 1]
        table = np.column_stack([always, offered[chosen].T])
        table = table / np.abs(table).max(axis=0)
        if np.linalg.cond(table) < 1e5:
            left = there - table @ np.linalg.lstsq(table, there, rcond=None)[0]
            np.testing.assert_allclose(scores.gain[row], 1.0 - left @ left / (rest @ rest), atol=1e-6)
            used += bool(chosen)
    assert used > 20


def test_a_column_costs_the_nodes_of_the_output_that_it_is_made_of() -> None:
    problem = LinkedProblem(INPUTS, values_of("a*b/(1 + c)"), BY_NAME["quotient"])
    run = Generations(problem, Settings(SEQUENCES, budget=BUDGET), np.random.default_rng(2))
    population, scores = run.start()
    for row in range(40):
        program = population.program(row, run.layout)
        chosen = {k % len(program.outputs) for k in range(8) if scores.chosen[row] >> k & 1}
        assert scores.complexity[row] == (program.select(sorted(chosen)).complexity if chosen else 0)
    assert values(population.decoder(run.layout)(slice(0, 4)), run.fixed).shape == (4, 4, 80)


@pytest.mark.parametrize("response", [np.ones(80), np.full(80, np.nan), np.ones(2)])
def test_a_response_without_anything_to_explain_is_one_clear_line(response: np.ndarray) -> None:
    with pytest.raises(InputError, match="response") as caught:
        regression_front(INPUTS, response, np.random.default_rng(0), 1.0)
    assert "\n" not in str(caught.value)
