"""Test that a fit excludes the largest errors, up to a share of all poses."""

import numpy as np
import pytest

from gpmodel.numerics.least_squares import OUTLIER_SHARE, among_worst


@pytest.mark.parametrize("count", [5, 12, 40, 101])
@pytest.mark.parametrize("passes", [1, 2, 4])
def test_the_share_is_excluded_whatever_the_number_of_passes(count: int, passes: int) -> None:
    errors = np.random.default_rng(count).permutation(count).astype(float)
    most = max(1, int(OUTLIER_SHARE * count))
    use = np.ones(count, dtype=bool)
    for k in range(passes):
        far = errors >= np.sort(errors)[-max(1, (k + 1) * most // passes)]
        use &= ~(far & among_worst(errors, use))
    assert sorted(errors[~use]) == list(range(count - most, count))
    assert not (use & among_worst(errors, use)).any()


def test_nothing_more_is_excluded_where_more_than_the_share_is_already() -> None:
    use = np.arange(40) >= 10
    assert not among_worst(np.arange(40.0), use).any()
