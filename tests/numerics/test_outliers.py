"""Outliers, alone and in groups."""

import numpy as np

from gpmodel.numerics.outliers import in_company, outlier_limit


def test_those_far_out_with_their_neighbours_the_same_way_are_told_from_outliers() -> None:
    rng = np.random.default_rng(0)
    places = rng.uniform(-1.0, 1.0, (400, 6))
    places[:12] = 0.9 + 0.05 * rng.standard_normal((12, 6))
    errors = 0.05 * rng.standard_normal((400, 3))
    errors[:12] += (2.0, 0.5, 0.0)
    alone = rng.choice(np.arange(12, 400), 8, replace=False)
    errors[alone] += 2.0 * rng.standard_normal((8, 3))
    lengths = np.linalg.norm(errors, axis=1)
    far = lengths > outlier_limit(lengths)
    company = in_company(far, places, errors)
    np.testing.assert_array_equal(np.flatnonzero(company), np.arange(12))
    turned = errors * rng.choice([-1.0, 1.0], (400, 1))
    assert not in_company(far, rng.permutation(places), turned).any()
    assert not in_company(far[:8], places[:8], errors[:8]).any()
    assert not in_company(far, np.zeros((400, 6)), errors).any()
