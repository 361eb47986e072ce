"""Test that `verify` divides rows of two tools, and judges the machine with the division allowed for."""

from dataclasses import replace

import numpy as np
import pytest
from verify_cases import NOISE, Fitted, fitted_robot, placed_anew, read_later

from gpmodel.arrays import Mask
from gpmodel.mechanism.branches import random_poses
from gpmodel.table.dataset import Dataset
from gpmodel.wording import some

TWO, CHANGED, SLIPPED = "two tools in one table", "tool changed after row {}: tool point", "tool slipped after row {}"


@pytest.fixture(scope="module")
def fitted() -> Fitted:
    return fitted_robot()


def two_tools(fitted: Fitted, second: Mask, apart: float, zero: float) -> Dataset:
    """Later poses; the tool of the rows `second` is displaced by `apart`, m, and the zero of J3 by `zero`, rad."""
    made, rng = fitted[1], np.random.default_rng(len(second))
    placement, q = placed_anew(made, rng), random_poses(fitted[1].model.mechanism, len(second), rng)
    moved = placement.tool[""] @ np.block([[np.eye(3), apart * np.array([[0.6], [0.0], [0.8]])], [np.zeros(3), 1.0]])
    one, other = (
        read_later(made, q, replace(placement, tool={"": tool}), rng, joint=2, moved=zero)
        for tool in (placement.tool[""], moved)
    )
    return replace(one, position=np.where(second[:, None], other.position, one.position))


def mixed(count: int, share: float) -> Mask:
    return np.asarray(np.random.default_rng(1).permutation(count) < share * count)


@pytest.mark.parametrize(
    ("second", "apart", "zero", "name"),
    [
        (mixed(30, 0.5), 2.5e-3, 0.0, TWO),
        (mixed(30, 0.5), 3e-4, 0.0, TWO),
        (mixed(12, 0.5), 2.5e-3, 0.0, TWO),
        (mixed(60, 0.2), 1e-3, 0.0, TWO),
        (mixed(30, 0.5), 2.5e-3, 5e-4, TWO),
        (np.arange(30) >= 15, 2.5e-3, 0.0, SLIPPED.format(15)),
        (np.arange(12) >= 10, 2.5e-3, 0.0, CHANGED.format(10)),
        (np.arange(60) >= 48, 1e-3, 0.0, CHANGED.format(48)),
    ],
)
def test_rows_of_two_tools_are_divided(fitted: Fitted, second: Mask, apart: float, zero: float, name: str) -> None:
    found = fitted[0].verify(two_tools(fitted, second, apart, zero))
    first, *others = found.record.changes
    its_rows, the_others = (some((np.flatnonzero(rows) + 1).tolist()) for rows in (second, ~second))
    named = f"{name}: the tool point of {{}} rows ({{}}) differs" if name == TWO else name
    assert first.name in (named.format(second.sum(), its_rows), named.format((~second).sum(), the_others))
    assert abs(first.value - apart) < 4 * first.stderr < 4 * NOISE
    assert [change.name for change in others] == (["zero of J3"] if zero else [])
    assert not found.holds
    assert ("not the machine: " in found.verdict) == (not zero)
    assert "explain" in found.verdict


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.long) for k in range(1, 6))])
def test_errors_of_one_tool_are_not_divided(fitted: Fitted, seed: int) -> None:
    """A drifting instrument, heavy tails, and gross errors of a tenth of the rows."""
    rng = np.random.default_rng(seed)
    data = two_tools(fitted, np.zeros(20 + seed, dtype=bool), 0.0, 0.0)
    shape = data.position.shape
    drift, tails = np.cumsum(rng.normal(0.0, 5e-5, shape), axis=0), 2 * NOISE * rng.standard_t(2, shape)
    gross = rng.normal(0.0, 2e-3, shape) * (rng.permutation(shape[0]) < 2)[:, None]
    for error in (drift, tails, gross):
        said = fitted[0].verify(replace(data, position=data.position + error)).verdict
        assert TWO not in said
        assert "tool changed after" not in said
