"""Tails of a sample: the distribution it was drawn from, and how sure a small one is of it."""

import numpy as np
import pytest

from gpmodel.numerics.tails import FREEDOMS, tails, with_far_ones


@pytest.mark.parametrize("freedom", [3.0, 1000.0])
def test_a_large_sample_tells_its_degrees_of_freedom_and_its_scale(freedom: float) -> None:
    values = 2e-5 * np.random.default_rng(1).standard_t(freedom, 6000)
    found = tails(values, len(values))
    best = int(np.argmax(found.weight))
    assert found.weight.sum() == pytest.approx(1.0)
    assert abs(FREEDOMS.index(FREEDOMS[best]) - FREEDOMS.index(freedom)) <= 1
    assert found.scale[best] == pytest.approx(2e-5, rel=0.05)


def test_what_is_drawn_is_as_wide_and_as_long_tailed_as_the_sample() -> None:
    rng = np.random.default_rng(2)
    drawn = tails(rng.standard_t(4.0, 5000), 5000).drawn((50, 200, 3), rng)
    wanted = rng.standard_t(4.0, drawn.size)
    for level in (50, 90, 99):
        assert np.percentile(np.abs(drawn), level) == pytest.approx(np.percentile(np.abs(wanted), level), rel=0.1)


@pytest.mark.long
def test_the_scale_of_a_small_sample_is_as_unsure_as_samples_differ() -> None:
    rng = np.random.default_rng(3)
    scales = [np.log(tails(rng.normal(size=40), 40).scale[-1]) for _ in range(300)]
    assert np.std(scales) == pytest.approx(tails(rng.normal(size=40), 40).uncertain[-1], rel=0.15)


def test_errors_left_out_are_tails_of_one_distribution_or_failures() -> None:
    rng = np.random.default_rng(4)
    heavy, normal = rng.standard_t(3.0, (200, 3)), rng.normal(size=(200, 3))
    out = np.linalg.norm(heavy, axis=1) > 8.0
    assert out.any()
    share = with_far_ones(heavy[~out], heavy[out], 3 * (~out).sum()).weight
    assert share[: len(FREEDOMS)].sum() > 0.9
    share = with_far_ones(normal, np.array([[60.0, 0.0, 20.0], [-30.0, 40.0, 5.0]]), normal.size).weight
    assert share[: len(FREEDOMS)].sum() < 1e-6


def test_what_a_fit_does_to_tails_is_undone() -> None:
    """Residuals of least squares are sums of many errors and look more normal than these."""
    rng, found = np.random.default_rng(5), []
    for _ in range(12):
        errors, columns = rng.standard_t(3.0, 300), np.linalg.qr(rng.normal(size=(300, 40)))[0]
        leverage = np.sum(columns**2, axis=1)
        left = (errors - columns @ (columns.T @ errors)) / (1.0 - leverage)
        blurs = np.zeros(300), leverage / (1.0 - leverage)
        found.append([np.sum(np.log(FREEDOMS) * tails(left, 260.0, blur).weight) for blur in blurs])
    plain, undone = np.exp(np.mean(found, axis=0))
    assert abs(undone - 3.0) < 0.5 * abs(plain - 3.0)
