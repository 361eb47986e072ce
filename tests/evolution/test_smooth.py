"""Test that smooth functions at a site recover simulated factors and weighted sums, given the columns of the model."""

import numpy as np
import pytest
from numpy.typing import NDArray

from gpmodel.evolution.projection import Targets
from gpmodel.evolution.smooth import (
    LENGTH,
    Sines,
    distance,
    factors,
    product_and_summand,
    smooth,
    summands,
    through,
    weighted_sum,
    without,
)

Array = NDArray[np.float64]
POSES, NOISE = 150, 0.05


def planted(shape: Array, noise: float, seed: int) -> tuple[Targets, Array, Array]:
    """A place that moves each pose by another amount, beside five columns that the model has; its motions and rows."""
    rng = np.random.default_rng(seed)
    motion = rng.uniform(0.5, 1.5, (POSES, 3))
    enabled = np.linalg.qr(rng.normal(size=(3 * POSES, 5)))[0]
    rows = (motion * shape[:, None] + noise * shape.std() * rng.normal(size=(POSES, 3))).ravel()
    rows -= enabled @ (enabled.T @ rows)
    cross = np.einsum("nik,ni->kn", enabled.reshape(POSES, 3, 5), motion)
    pull = np.einsum("ni,ni->n", motion, rows.reshape(POSES, 3))
    weight = np.sum(motion**2, axis=1)
    targets = Targets(weight[None], cross[None], pull[None], float(rows @ rows), ("here",), 3 * POSES)
    return targets, motion, rows


def alike(first: Array, second: Array) -> float:
    """Size of the cosine between two functions."""
    return abs(float(first @ second) / float(np.linalg.norm(first) * np.linalg.norm(second)))


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_the_factors_of_a_product_are_found(seed: int, count: int) -> None:
    columns = np.random.default_rng(100 + seed).uniform(-2.0, 2.0, (3, POSES))[:count]
    shapes = (lambda u: np.tanh(3.0 * u) + 0.4, lambda v: np.sqrt(2.2 + v) * np.sin(v), lambda w: w - 0.5)
    wanted = np.array([shape(column) for shape, column in zip(shapes, columns, strict=False)])
    product = np.prod(wanted, axis=0)
    noise, found = factors(planted(product, NOISE, seed)[0], columns)
    assert 0.5 < noise / (NOISE * product.std()) ** 2 < 2.0
    for one, other in zip(found, wanted, strict=True):
        assert alike(one, other) > 0.99
        assert np.mean(one**2) == pytest.approx(1.0)


@pytest.mark.parametrize("weights", [(1.0, 0.3), (0.2, -1.0), (1.0, 1.0), (0.6, -1.0, 0.4), (1.0, 1.0, -0.3)])
def test_the_weights_of_a_sum_are_found(weights: tuple[float, ...]) -> None:
    sizes = np.array([1.0, 50.0, 3.0])[: len(weights)]
    columns = np.random.default_rng(7).uniform(-2.0, 2.0, (len(weights), POSES)) * sizes[:, None]
    scaled = np.array(weights) / sizes
    targets, _, _ = planted(np.sin(2.0 * (scaled @ columns) - 0.5), NOISE, 1)
    found = weighted_sum(targets, columns)
    assert found[1:] / found[0] == pytest.approx(scaled[1:] / scaled[0], rel=0.05, abs=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_a_product_and_what_is_added_to_it_are_found(seed: int) -> None:
    u, v, w = columns = np.random.default_rng(300 + seed).uniform(-2.0, 2.0, (3, POSES))
    product, summand = np.tanh(3.0 * u) * np.exp(0.7 * v), np.sin(2.0 * w)
    noise, *found = product_and_summand(planted(product + summand, NOISE, seed)[0], columns)
    assert 0.5 < noise / (NOISE * (product + summand).std()) ** 2 < 2.0
    for one, other in zip(found, (product, summand), strict=True):
        assert alike(one - one.mean(), other - other.mean()) > 0.98


@pytest.mark.parametrize("seed", range(3))
def test_the_summands_of_a_sum_are_found(seed: int) -> None:
    u, v = np.random.default_rng(200 + seed).uniform(-2.0, 2.0, (2, POSES))
    wanted = np.tanh(3.0 * u), 0.5 * np.sin(2.0 * v)
    found = summands(planted(wanted[0] + wanted[1], NOISE, seed)[0], np.array([u, v]))
    for one, other in zip(found, wanted, strict=True):
        assert alike(one - one.mean(), other - other.mean()) > 0.99


def test_two_factors_that_both_oscillate_more_than_once_are_found() -> None:
    columns = np.random.default_rng(21).uniform(-2.0, 2.0, (2, POSES))
    wanted = np.sin(3.6 * columns + np.array([[0.5], [1.0]]))
    _, found = factors(planted(wanted[0] * wanted[1], NOISE, 3)[0], columns)
    assert min(alike(one, other) for one, other in zip(found, wanted, strict=True)) > 0.97


@pytest.mark.parametrize("centre", [(0.4, -0.6), (-1.0, 0.0)])
def test_the_point_that_a_distance_counts_from_is_found(centre: tuple[float, float]) -> None:
    u, v = np.random.default_rng(11).uniform(-2.0, 2.0, (2, POSES))
    away = np.hypot(u - centre[0], 1.3 * (v - centre[1]))
    columns = np.array([u, 50.0 * v])
    a, b, w = distance(planted(np.tanh(2.0 * away - 2.0), NOISE, 1)[0], columns)
    assert (a, b / 50.0) == pytest.approx(centre, abs=0.05)
    assert w * 50.0 == pytest.approx(1.3, rel=0.05)


def test_without_a_function_the_problem_is_that_of_the_rest() -> None:
    """Once a function is taken off, nothing is left of it to gain, and of another what it adds."""
    u, v = np.random.default_rng(3).uniform(-1.0, 1.0, (2, POSES))
    targets, _, _ = planted(u + 0.5 * np.exp(v), NOISE, 2)
    both = np.array([u, np.exp(v)])
    gain, coefficients = targets.set_gain(both, 0)
    rest = without(targets, coefficients @ both)
    assert rest.energy == pytest.approx((1.0 - gain) * targets.energy, rel=1e-9)
    assert np.max(rest.gains(both)) < 1e-12


def test_through_a_factor_the_problem_is_that_of_the_other() -> None:
    """Gains of g on the problem through f are those of f·g on the problem itself."""
    u, v = np.random.default_rng(3).uniform(-1.0, 1.0, (2, POSES))
    targets, _, _ = planted(u * np.exp(v), NOISE, 2)
    some = np.array([v, np.exp(v), np.cos(3.0 * v)])
    np.testing.assert_allclose(through(targets, u).gains(some), targets.gains(some * u), rtol=1e-12)


@pytest.mark.long
def test_nats_are_those_of_the_gaussian_process() -> None:
    """Against the marginal likelihood of the rows with a covariance of N x N, at the variance that was found."""
    u = np.random.default_rng(5).uniform(-1.0, 1.0, POSES)
    targets, motion, rows = planted(np.tanh(3.0 * u), 0.3, 4)
    basis = Sines.of("", u, LENGTH).values
    noise = targets.energy / targets.components
    found = smooth(targets, basis, noise)
    enabled_free = Targets(targets.weight, np.zeros_like(targets.cross), targets.pull, targets.energy, ("here",), 450)
    free = smooth(enabled_free, basis, noise)
    columns = (motion[:, :, None] * basis[:, None, :]).reshape(3 * POSES, -1)

    def likelihood(variance: float) -> float:
        both = noise * np.eye(3 * POSES) + variance * columns @ columns.T
        return float(-0.5 * rows @ np.linalg.solve(both, rows) - 0.5 * np.linalg.slogdet(both)[1])

    best = max(likelihood(v) for v in np.geomspace(1e-4, 1e4, 200)) - likelihood(0.0)
    assert free.nats == pytest.approx(best, abs=0.5)
    assert 0.0 < found.nats <= free.nats + 5.0


def test_of_noise_a_function_is_nothing() -> None:
    rng = np.random.default_rng(6)
    u, v = rng.uniform(-1.0, 1.0, (2, POSES))
    targets, _, _ = planted(rng.normal(size=POSES), 10.0, 5)
    basis = Sines.of("", u, LENGTH).values
    assert smooth(targets, basis, targets.energy / targets.components).nats < 3.0
    assert np.isfinite(factors(targets, np.array([u, v]))[1]).all()
