"""Products of powers under noise: what they leave of a response, which exponents are simple, how they are scored."""

import numpy as np
import pytest
from linked_cases import COLUMNS, INPUTS, every_other, values_of

from gpmodel.evolution.kernels.products import share_left_by_products
from gpmodel.evolution.linked_problem import PRICE, LinkedProblem
from gpmodel.evolution.linked_solution import solved
from gpmodel.evolution.linked_terms import Terms
from gpmodel.evolution.links import BROKEN_POWER, FITS, LARGEST_POWER, LINKS, POWER, LinkTerm
from gpmodel.formula.parse import parse

PRODUCT = next(link for link in LINKS if link.weighted)
WORTH = PRICE * BROKEN_POWER


def noisy(law: str, seed: int = 0) -> np.ndarray:
    clean = values_of(law)
    return clean + 0.01 * clean.std() * np.random.default_rng(seed).normal(size=80)


def left_by_product(table: np.ndarray, always: int, response: np.ndarray) -> tuple[float, list[int]]:
    """What ``share_left_by_products`` says it computes, for one program: rows (k, N), the first ``always`` in all."""
    size = np.abs(response)
    root, there, left = size, np.log(size), np.inf
    variance = float(np.sum(np.square(response - response.mean())))
    for _ in range(FITS):
        linked = np.linalg.lstsq((root * table).T, root * there, rcond=None)[0] @ table
        root = np.exp(linked)
        total = float(np.sum(np.square(size - root)))
        there = linked + (size - root) / root
        left = min(left, total / variance)
    free, held = list(range(1, len(table))), np.zeros(len(table))

    def solution(fixed: list[int]) -> tuple[np.ndarray, float]:
        others = [k for k in range(len(table)) if k not in fixed]
        rest = root * (there - held[fixed] @ table[fixed])
        found = np.linalg.lstsq((root * table[others]).T, rest, rcond=None)[0]
        whole = held.copy()
        whole[others] = found
        return whole, float(np.sum(np.square(root * (there - whole @ table))))

    while True:
        fixed = [k for k in range(1, len(table)) if k not in free]
        found, least = solution(fixed)
        simple = np.where(np.abs(found) <= LARGEST_POWER, 0.5 * np.round(2.0 * found), 0.0)
        losses = []
        for k in free:
            held[k] = simple[k]
            losses.append(solution([*fixed, k])[1] - least)
            held[k] = 0.0
        if not free or not 0.5 * len(response) * np.log1p(min(losses) / total) < WORTH:
            return left, [len(free), int(np.count_nonzero(np.abs(found[1:always]) > 1e-9))]
        place = int(np.argmin(losses))
        left, total = left + losses[place] / variance, total + losses[place]
        held[free[place]] = simple[free[place]]
        free.pop(place)


@pytest.mark.long
@pytest.mark.parametrize(
    "law", ["3*cos(a)*b**2/c", "2*exp(0.3*log(a))*b", "b*exp(-a*c)", "sin(3*a)*sqrt(c)/b", "1 + a*sin(b)"]
)
def test_what_products_leave_is_what_they_leave_of_the_response(law: str) -> None:
    response = noisy(law)
    always = np.stack([np.ones(80), *(np.log(COLUMNS[name]) for name in "abc")])
    offered = np.stack([values_of(text) for text in ("a*c", "log(cos(a))", "sin(b)", "log(sin(3*a))")])
    chosen = np.array([0b0011, 0b1000, 0b1111, 0b0000])
    left, written = np.full(4, 0.25), np.zeros((4, 2), np.int64)
    terms = np.repeat(offered[None], 4, axis=0)
    share_left_by_products(terms, chosen, always, response, FITS, WORTH, LARGEST_POWER, left, written)
    for k, bits in enumerate(chosen[:3].tolist()):
        table = np.vstack([always, offered[[i for i in range(4) if bits >> i & 1]]])
        expected, counts = left_by_product(table, len(always), response)
        np.testing.assert_allclose(left[k], expected, rtol=1e-5)
        assert written[k].tolist() == counts
    assert (left[3], written[3].tolist()) == (0.25, [0, 0])


def test_a_product_whose_factors_are_alike_is_left_out() -> None:
    always = np.stack([np.ones(80), np.log(COLUMNS["a"])])
    left, written = np.ones(1), np.zeros((1, 2), np.int64)
    terms = np.log(2.0 * COLUMNS["a"])[None, None]
    share_left_by_products(terms, np.array([1]), always, values_of("1/a"), FITS, WORTH, LARGEST_POWER, left, written)
    assert left[0] == np.inf


def test_values_below_the_noise_do_not_rule_a_product() -> None:
    columns = COLUMNS | {"a": 3.0 * COLUMNS["a"]}
    response = parse("b*exp(-a*c)").evaluate(columns)[0]
    spread = 0.01 * response.std()
    assert np.count_nonzero(np.abs(response) < spread) > 20
    terms = [LinkTerm(parse(text)) for text in ("1", "log(a)", "log(b)", "log(c)", "a*c")]
    for seed in range(4):
        measured = response + spread * np.random.default_rng(seed).normal(size=80)
        found = solved(terms, PRODUCT, columns, measured, PRICE)
        assert found is not None
        assert np.sqrt(np.mean(np.square(found.evaluate(columns)[0] - response))) < spread


def test_at_a_fit_the_response_to_solve_for_is_the_fit_where_nothing_is_left() -> None:
    response = values_of("a - 2*b")
    root, there = PRODUCT.at_fit(response, np.log(np.abs(response)))
    np.testing.assert_allclose(there, np.log(np.abs(response)), rtol=1e-12)
    np.testing.assert_allclose(root, np.abs(response) / np.abs(response).max(), rtol=1e-12)


def test_products_are_scored_by_what_they_leave_of_the_response_and_what_is_written() -> None:
    response = noisy("a*cos(b)/sin(b)")
    problem = LinkedProblem(INPUTS, response, PRODUCT)
    used = 0
    for row, program, scores in every_other(problem):
        chosen = int(scores.chosen[row])
        outputs = program.evaluate(COLUMNS)
        offered = np.vstack([outputs, PRODUCT.companions(outputs[None], response)[0]])
        picked = [k for k in range(8) if chosen >> k & 1]
        table = np.vstack([problem.factors, offered[picked]])
        weighted = (response * table).T
        if picked and np.linalg.cond(weighted / np.abs(weighted).max(axis=0)) < 1e3:
            left, (free, powers) = left_by_product(table, len(problem.factors), response)
            nodes = program.select(sorted({k % 4 for k in picked})).complexity
            size = nodes + BROKEN_POWER * free + POWER * powers
            np.testing.assert_allclose(scores.gain[row], 1.0 - left, atol=1e-6)
            assert scores.complexity[row] == size
            np.testing.assert_allclose(scores.score[row], 40.0 * np.log(left) + PRICE * (size + len(picked)), atol=1e-3)
            used += 1
    assert used > 20


def test_climbing_sees_the_price_of_exponents_that_are_not_simple() -> None:
    response = noisy("a*cos(b)/sin(b)")
    terms = Terms(LinkedProblem(INPUTS, response, PRODUCT), 0)
    simple, near = (np.stack([values_of(text) for text in texts]) for texts in (
        ("log(cos(b))", "log(sin(b))"), ("log(cos(b))", "b")
    ))  # fmt: skip
    gains = terms.set_gains(list(np.stack([simple, near], axis=1)), 0)
    assert terms.nats(gains[0], 6.0) > terms.nats(gains[1], 5.0) + WORTH
    assert terms.set_gain(simple, 0) == pytest.approx(gains[0])
