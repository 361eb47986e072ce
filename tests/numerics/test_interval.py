"""Test the probabilities of large ratios of variances, also of those too small for a number."""

import numpy as np
import pytest

from gpmodel.numerics.interval import chance_of_ratio, log_chances_of_ratio


@pytest.mark.parametrize("ratio", [0.5, 3.0, 400.0, 1e4])
@pytest.mark.parametrize("freedom", [6.0, 3000.0, np.inf])
def test_the_chance_of_a_ratio_of_two_deviates_has_a_closed_form(ratio: float, freedom: float) -> None:
    """(1 + 2 r / ν)^(-ν/2), and e^(-r) of a known variance."""
    exact = -ratio if np.isinf(freedom) else -0.5 * freedom * np.log1p(2.0 * ratio / freedom)
    found = float(log_chances_of_ratio(np.array(ratio), np.array(2), np.array(freedom)))
    assert found == pytest.approx(exact, rel=1e-9)
    assert chance_of_ratio(ratio, 2, freedom) == pytest.approx(np.exp(exact), rel=1e-7)


@pytest.mark.parametrize("freedom", [3000.0, np.inf])
@pytest.mark.parametrize("numbers", [1, 3, 6])
def test_small_and_tiny_chances_continue_each_other(numbers: int, freedom: float) -> None:
    """Around a chance of 1e-290, the slope of the logarithm is continuous."""
    ratios = np.geomspace(1.0, 1e4, 4000)
    found = log_chances_of_ratio(ratios, np.full(4000, numbers), np.full(4000, freedom))
    steps = np.diff(found) / np.diff(ratios)
    near = np.abs(found[1:-1] + 290 * np.log(10)) < 50
    assert near.any()
    np.testing.assert_allclose(np.diff(steps)[near] / steps[1:][near], 0.0, atol=0.02)
