"""Factors of intervals, against those of the guide and against draws."""

import numpy as np
import pytest

from gpmodel.numerics.interval import coverage_factor, freedom_of_sum


@pytest.mark.parametrize(("freedom", "factor"), [(4.0, 2.776), (20.0, 2.086), (np.inf, 1.960)])
def test_the_factor_is_that_of_the_guide(freedom: float, factor: float) -> None:
    """Source: JCGM 100 (2008), table G.2."""
    assert coverage_factor(freedom) == pytest.approx(factor, abs=1e-3)


def test_a_sum_has_at_most_the_freedom_of_both_and_at_least_that_of_the_larger() -> None:
    freedoms = np.array([[8.0], [12.0]])
    np.testing.assert_allclose(freedom_of_sum(np.array([[1.0, 1.0], [0.0, 1.0]]), freedoms), [8.0, 19.2])
    assert freedom_of_sum(np.ones((2, 1)), np.full((2, 1), np.inf))[0] == np.inf


def test_intervals_of_few_draws_hold_as_often_as_they_say() -> None:
    drawn = np.random.default_rng(0).normal(size=(20_000, 5))
    sigma = drawn.std(axis=1, ddof=1) / np.sqrt(5.0)
    assert np.mean(np.abs(drawn.mean(axis=1)) < coverage_factor(4.0) * sigma) == pytest.approx(0.95, abs=0.005)
