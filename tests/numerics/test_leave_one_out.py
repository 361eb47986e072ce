"""Columns without the others, held against least squares that leaves each of them out."""

import numpy as np
import pytest

from gpmodel.numerics.least_squares import LeaveOneOut

RNG = np.random.default_rng(3)
COLUMNS = RNG.normal(size=(40, 6)) * [1.0, 1e-4, 3.0, 1.0, 50.0, 1.0]
COLUMNS[:, 5] = COLUMNS[:, 0] - 2.0 * COLUMNS[:, 3]
VALUES = RNG.normal(size=(40, 2))


@pytest.mark.parametrize(("count", "k"), [(5, 0), (5, 1), (5, 4), (6, 0), (6, 1), (6, 5)])
def test_it_is_what_least_squares_without_the_column_leaves(count: int, k: int) -> None:
    """One of six columns is made of two others."""
    columns = COLUMNS[:, :count]
    others = np.delete(columns, k, axis=1)
    found = LeaveOneOut.of(columns)
    left = columns[:, k] - others @ np.linalg.lstsq(others, columns[:, k], rcond=1e-10)[0]
    np.testing.assert_allclose(found.alone(k), left, atol=1e-9 * np.linalg.norm(columns[:, k]))
    if np.linalg.norm(left) > 1e-9:
        coefficients = found.by_others(k, VALUES)
        nearest = others @ np.linalg.lstsq(others, VALUES, rcond=1e-10)[0]
        np.testing.assert_allclose(coefficients[k], 0.0, atol=1e-12)
        np.testing.assert_allclose(columns @ coefficients, nearest, atol=1e-9)
