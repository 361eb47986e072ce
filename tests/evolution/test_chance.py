"""Test the permutation p-value: counted where permuted scores reach the score, extrapolated beyond."""

import numpy as np
import pytest

from gpmodel.evolution.chance import chance_of

NULL = np.random.default_rng(0).gumbel(0.0, 1.0, 400)


def test_it_falls_with_the_value_and_follows_the_law_of_maxima() -> None:
    found = [chance_of(v, NULL) for v in (-2.0, 0.0, 2.0, 5.0, 20.0)]
    assert [c.p for c in found] == sorted((c.p for c in found), reverse=True)
    assert found[1].p == pytest.approx(1 - np.exp(-1), abs=0.1)
    assert found[3].p == pytest.approx(1 - np.exp(-np.exp(-5.0)), abs=0.01)
    assert found[4].p < 1e-6


def test_what_lies_beyond_every_shuffle_is_extrapolated_and_what_does_not_is_counted() -> None:
    far = chance_of(20.0, NULL)
    assert far.p < 1 / 401
    assert far.shuffles == 400
    assert chance_of(NULL.max() - 0.1, NULL).p >= 2 / 401


@pytest.mark.parametrize("null", [[], [0.0], [0.0, 1.0], [-np.inf, -np.inf, 1.0, 2.0]])
def test_too_few_shuffles_claim_nothing(null: list[float]) -> None:
    assert chance_of(100.0, np.array(null)).p == 1.0


def test_few_shuffles_cost_certainty() -> None:
    far = [chance_of(12.0, NULL[:count]).p for count in (4, 20, 400)]
    assert far[0] > 10 * far[1] > 10 * far[2]


@pytest.mark.long
@pytest.mark.parametrize(("shuffles", "level", "most"), [(19, 0.05, 0.065), (19, 0.01, 0.017), (8, 0.01, 0.02)])
def test_a_score_of_chance_is_called_significant_about_as_often_as_said(
    shuffles: int, level: float, most: float
) -> None:
    rng = np.random.default_rng(1)
    hits = [chance_of(rng.gumbel(), rng.gumbel(0.0, 1.0, shuffles)).p < level for _ in range(2000)]
    assert np.mean(hits) < most
