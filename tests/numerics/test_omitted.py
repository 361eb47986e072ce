"""Rows left out of a least-squares problem against the fit to the others."""

import numpy as np
import pytest

from gpmodel.numerics.least_squares import Omitted
from gpmodel.numerics.rank import orthonormal


@pytest.mark.parametrize("count", [4, 20])
def test_what_a_fit_to_the_other_rows_misses_by_is_told_from_the_fit_to_all(count: int) -> None:
    rng = np.random.default_rng(0)
    columns, values = rng.normal(size=(60, 12)), rng.normal(size=(60, 3))
    rows = rng.permutation(60)[:count]
    others = np.delete(np.arange(60), rows)
    basis = orthonormal(columns)
    solved = np.linalg.lstsq(columns[others], values[others], rcond=None)[0]
    found = Omitted.of(rows, basis).freed((values - basis @ (basis.T @ values))[rows])
    np.testing.assert_allclose(found, values[rows] - columns[rows] @ solved, rtol=1e-9, atol=1e-9)
