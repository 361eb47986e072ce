"""Test variance components: sizes of random coefficients, and a fixed coefficient given them."""

import numpy as np
import pytest

from gpmodel.numerics.variances import Mixed


def model(seed: int, size: float, factor: float, *, alike: float = 0.0) -> tuple[Mixed, np.ndarray]:
    """120 values: ten coefficients of size 1 and ten of `size`, a column times `factor`, and noise 0.1."""
    rng = np.random.default_rng(seed)
    groups = [rng.normal(size=(120, 10)) for _ in range(2)]
    column = rng.normal(size=120) + alike * groups[1].sum(axis=1)
    values = groups[0] @ rng.normal(0.0, 1.0, 10) + groups[1] @ rng.normal(0.0, size, 10)
    values = values + factor * column + rng.normal(0.0, 0.1, 120)
    return Mixed.of(groups, (0.5, 0.5, 0.05), values, 120), column


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_the_sizes_of_groups_and_noise_are_estimated(size: float) -> None:
    found = np.array(
        [mixed.given(column).deviations()[0] for mixed, column in (model(s, size, 0.2) for s in range(40))]
    )
    assert np.sqrt(np.mean(found**2, axis=0)) == pytest.approx([1.0, size, 0.1], rel=0.2)


def test_a_column_of_no_effect_exceeds_a_chance_as_often_as_the_chance_says() -> None:
    chances = np.array(
        [mixed.fixed(column).chance for mixed, column in (model(s, 1.0, 0.0, alike=3.0) for s in range(200))]
    )
    assert np.mean(chances < 0.1) == pytest.approx(0.1, abs=0.06)


def test_a_column_is_estimated_less_well_the_larger_the_effects_that_resemble_it() -> None:
    small, large = (model(1, size, 0.2, alike=3.0) for size in (0.1, 3.0))
    sure, unsure = small[0].fixed(small[1]), large[0].fixed(large[1])
    assert sure.stderr < unsure.stderr
    assert sure.value == pytest.approx(0.2, abs=4 * sure.stderr)
