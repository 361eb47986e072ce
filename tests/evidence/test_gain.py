"""Test the prior variance with the largest evidence of a group against NumPy."""

import numpy as np
import pytest

from gpmodel.arrays import Array
from gpmodel.evolution.variances import best


def gain(variance: Array, s: Array, q: Array) -> Array:
    """½ Σ [a q² / (1 + a s) - ln(1 + a s)] (G, T) at variances (G, T)."""
    load = variance[:, :, None] * s[:, None, :]
    return np.asarray(0.5 * np.sum(variance[:, :, None] * q[:, None, :] ** 2 / (1.0 + load) - np.log1p(load), axis=2))


def test_no_variance_on_a_fine_grid_beats_the_best() -> None:
    rng = np.random.default_rng(0)
    s, q = rng.gamma(1.0, 1e8, (50, 4)), rng.normal(0, 3e4, (50, 4))
    gains, _ = best(s, q, np.full(50, 5e-3))
    fine = gain(np.tile(np.geomspace(1e-15, 2.5e-5, 3000), (50, 1)), s, q)
    assert (gains >= fine.max(axis=1) * (1 - 2e-4) - 1e-3).all()


@pytest.mark.parametrize(("columns", "scale"), [(1, 1e8), (4, 1e8), (80, 1e8), (80, 1e-3), (12, 1e14)])
def test_the_best_variance_is_where_a_search_in_numpy_ends(columns: int, scale: float) -> None:
    """The best of 24 places in log a over ten decades, then twelve steps of a golden section beside it."""
    rng, golden, step = np.random.default_rng(0), 0.5 * (np.sqrt(5.0) - 1.0), 10.0 * np.log(10.0) / 23
    s, q = rng.gamma(1.0, scale, (50, columns)), rng.normal(0, 3.0 * np.sqrt(scale), (50, columns))
    top = 2.0 * np.log(5e-3)

    def at(x: Array) -> Array:
        return gain(np.exp(x)[:, None], s, q)[:, 0]

    places = top - step * np.arange(24)[::-1]
    middle = places[np.argmax(gain(np.exp(np.tile(places, (50, 1))), s, q), axis=1)]
    low, high = middle - step, np.minimum(middle + step, top)
    for _ in range(13):
        left, right = high - golden * (high - low), low + golden * (high - low)
        lower = at(left) > at(right)
        low, high = np.where(lower, low, left), np.where(lower, right, high)
    gains, where = best(s, q, np.full(50, 5e-3))
    assert np.log(where) == pytest.approx(np.where(lower, left, right), abs=1e-9)
    assert gains == pytest.approx(gain(where[:, None], s, q)[:, 0], rel=1e-9, abs=1e-9)
