"""Quotients of solved sums: what they leave of a response, how they are solved under noise, and how they are scored."""

import numpy as np
from linked_cases import COLUMNS, INPUTS, every_other, values_of

from gpmodel.evolution.kernels.quotients import share_left_by_quotients
from gpmodel.evolution.linked_problem import PASSES, PRICE, LinkedProblem
from gpmodel.evolution.linked_solution import solved
from gpmodel.evolution.links import LINKS, LinkTerm
from gpmodel.evolution.rows import unit_rows
from gpmodel.formula.parse import parse

QUOTIENT = next(link for link in LINKS if link.quotient)


def left_by_quotient(outputs: np.ndarray, chosen: int, response: np.ndarray) -> float:
    """What ``share_left_by_quotients`` says it computes, for one program."""
    count = len(outputs)
    above = np.stack([np.ones(len(response)), *(outputs[k] for k in range(count) if chosen >> k & 1)])
    below = np.stack([outputs[k] - outputs[k].mean() for k in range(count) if chosen >> (k + count) & 1])
    root, left = np.ones(len(response)), np.inf
    for _ in range(PASSES):
        table = root * np.vstack([above, below * response])
        found = np.linalg.lstsq(table.T, root * response, rcond=None)[0]
        denominator = 1.0 - found[len(above) :] @ below
        rest = response - found[: len(above)] @ above / denominator
        left = min(left, float(rest @ rest) / float(np.sum(np.square(response - response.mean()))))
        root = 1.0 / np.abs(denominator)
    return left


def test_what_quotients_leave_is_what_they_leave_of_the_response() -> None:
    rng = np.random.default_rng(6)
    outputs = unit_rows(rng.normal(size=(12, 80))).reshape(4, 3, 80)
    response = 3.0 + 0.5 * rng.normal(size=80)
    chosen = np.array([0b001000, 0b010011, 0b111111, 0b000101])
    left = np.full(4, 0.25)
    share_left_by_quotients(outputs, chosen, response, PASSES, left)
    expected = [left_by_quotient(o, int(c), response) for o, c in zip(outputs[:3], chosen, strict=False)]
    np.testing.assert_allclose(left, [*expected, 0.25], rtol=1e-9)


def test_a_quotient_whose_terms_are_alike_is_left_out() -> None:
    outputs = unit_rows(np.stack([COLUMNS["a"], 2.0 * COLUMNS["a"]]))[None]
    left = np.ones(1)
    share_left_by_quotients(outputs, np.array([0b1100]), values_of("1/a"), PASSES, left)
    assert left[0] == np.inf


def test_a_quotient_with_noise_is_solved_for_the_errors_of_the_response() -> None:
    law = "(5 + 2*a)/(1 + 3*b*c)"
    noisy = values_of(law) + 0.03 * np.random.default_rng(0).normal(size=80)
    terms = [LinkTerm(parse("1")), LinkTerm(parse("a")), LinkTerm(parse("b*c"), below=True)]
    found = solved(terms, QUOTIENT, COLUMNS, noisy, PRICE)
    assert found is not None
    assert np.sqrt(np.mean(np.square(found.evaluate(COLUMNS)[0] - values_of(law)))) < 0.01


def test_a_denominator_that_is_infinite_somewhere_is_not_solved() -> None:
    terms = [LinkTerm(parse("a")), LinkTerm(parse("1/(b - b)"), below=True)]
    assert solved(terms, QUOTIENT, COLUMNS, values_of("a"), PRICE) is None


def test_quotients_are_scored_by_what_they_leave_of_the_response() -> None:
    response = values_of("0.02*a*b/c + 0.1/(1 + a)")
    problem = LinkedProblem(INPUTS, response, QUOTIENT)
    used = 0
    for row, program, scores in every_other(problem):
        chosen = int(scores.chosen[row])
        outputs = program.evaluate(COLUMNS)
        picked = [k for k in range(8) if chosen >> k & 1]
        table = unit_rows(np.vstack([np.ones(80), outputs, problem.link.companions(outputs[None], response)[0]]))
        if chosen >> 4 and np.linalg.cond(table[[0, *(k + 1 for k in picked)]].T) < 1e4:
            left = left_by_quotient(unit_rows(outputs), chosen, response)
            np.testing.assert_allclose(scores.gain[row], 1.0 - left, atol=1e-6)
            np.testing.assert_allclose(
                scores.score[row], 40.0 * np.log(left) + PRICE * (scores.complexity[row] + len(picked)), atol=1e-3
            )
            used += 1
    assert used > 20
