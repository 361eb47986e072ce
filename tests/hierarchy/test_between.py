"""Mean and spread between machines, and who stands out, on numbers drawn with known truth."""

from functools import partial

import numpy as np
import pytest
from scipy import stats

from gpmodel.hierarchy.between import INTERVAL, Deviations, between, deleted, deviations
from gpmodel.numerics.interval import SIGNIFICANCE, holm

FLEETS, MACHINES, PARAMETERS = 30, 12, 8


def drawn(seed: int, spread: float, machines: int = MACHINES) -> tuple[np.ndarray, np.ndarray]:
    """Estimates of machines with mean 5 and some spread, and their variances about one."""
    rng = np.random.default_rng(seed)
    variances = rng.uniform(0.5, 1.5, (machines, PARAMETERS))
    return 5.0 + rng.normal(size=variances.shape) * np.sqrt(variances + spread**2), variances


def judged(values: np.ndarray, variances: np.ndarray) -> Deviations:
    return deviations([partial(deleted, v, s) for v, s in zip(values.T, variances.T, strict=True)], len(values))


@pytest.mark.parametrize("spread", [0.0, 0.5, 2.0, 20.0])
def test_mean_and_spread_are_covered_as_often_as_they_say(spread: float) -> None:
    found = []
    for seed in range(FLEETS):
        values, variances = drawn(seed, spread)
        found += [between(values[:, k], variances[:, k]) for k in range(PARAMETERS)]
    t = np.abs([(b.mean - 5.0) / b.stderr for b in found])
    inside = [b.low <= spread <= b.high for b in found]
    sure = 3.0 * np.sqrt(0.05 * 0.95 / len(found))
    assert np.mean(t < stats.t.ppf(0.975, MACHINES - 1)) > INTERVAL - sure
    assert np.mean(inside) > INTERVAL - sure
    estimated = np.mean([b.spread**2 for b in found])
    assert estimated == pytest.approx(
        spread**2, abs=3.0 * (spread**2 + 1.0) * np.sqrt(2.0 / (MACHINES - 1) / len(found)) + 0.2
    )


@pytest.mark.parametrize("spread", [0.0, 1.0, 10.0])
def test_an_innocent_fleet_has_outliers_no_more_often_than_stated(spread: float) -> None:
    false = sum(not judged(*drawn(seed, spread)).inside.all() for seed in range(FLEETS))
    assert stats.binomtest(false, FLEETS, SIGNIFICANCE, alternative="greater").pvalue > 0.001


@pytest.mark.parametrize("others", [(), (3,)])
def test_planted_outliers_are_found_and_hide_no_other(others: tuple[int, ...]) -> None:
    values, variances = drawn(0, 1.0)
    values[7, 2] += 30.0
    for k in others:
        values[k, 4] -= 30.0
    found = judged(values, variances)
    assert set(zip(*np.nonzero(~found.inside), strict=True)) == {(7, 2), *((k, 4) for k in others)}
    assert found.chance[7, 2] < SIGNIFICANCE
    assert found.z[7, 2] > 0
    clean = np.delete(values[:, 2], 7)
    of = between(clean, np.delete(variances[:, 2], 7))
    assert abs(of.mean - 5.0) < 3.0 * of.stderr


def test_of_three_machines_none_stands_out() -> None:
    values, variances = drawn(0, 1.0, machines=3)
    values[0] += 1e3
    found = judged(values, variances)
    assert isinstance(found, Deviations)
    assert found.inside.all()


def test_units_do_not_matter() -> None:
    values, variances = drawn(1, 2.0)
    large, small = between(values[:, 0], variances[:, 0]), between(1e-9 * values[:, 0], 1e-18 * variances[:, 0])
    assert 1e-9 * large.spread == pytest.approx(small.spread, rel=1e-6)
    assert 1e-9 * large.high == pytest.approx(small.high, rel=1e-6)


def test_chances_corrected_for_their_number() -> None:
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03])), [0.03, 0.06, 0.06])
    np.testing.assert_allclose(holm(np.array([[0.5, 0.9]])), [[1.0, 1.0]])
    assert holm(np.zeros(0)).shape == (0,)
