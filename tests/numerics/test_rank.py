"""Identifiable parameters of matrices with known answers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpmodel.numerics import rank as ident

RNG = np.random.default_rng(0)
RANDOM = RNG.normal(size=(60, 8))


def test_orthonormal_spans_the_columns_whatever_their_units() -> None:
    columns = RANDOM * np.logspace(-4, 4, 8)
    basis = ident.orthonormal(columns)
    np.testing.assert_allclose(basis.T @ basis, np.eye(8), atol=1e-12)
    left = ident.remove(basis, columns)
    assert (np.linalg.norm(left, axis=0) < 1e-10 * np.linalg.norm(columns, axis=0)).all()


def test_orthonormal_counts_repeated_and_zero_columns_once_or_not_at_all() -> None:
    columns = np.column_stack([RANDOM[:, :3], RANDOM[:, 0] - 2 * RANDOM[:, 2], np.zeros(60), 1e-9 * RANDOM[:, 5]])
    assert ident.orthonormal(columns).shape == (60, 3)
    assert ident.orthonormal(np.zeros((60, 2))).shape == (60, 0)


def test_unique_share_is_the_part_no_other_column_explains() -> None:
    for k in range(8):
        others = ident.orthonormal(np.delete(RANDOM, k, axis=1))
        left = np.linalg.norm(ident.remove(others, RANDOM[:, [k]])) / np.linalg.norm(RANDOM[:, k])
        assert ident.unique_shares(RANDOM)[k] == pytest.approx(left, rel=1e-9)


@given(st.floats(1e-6, 1e6), st.integers(0, 7))
def test_unique_share_has_no_unit(factor: float, k: int) -> None:
    scaled = RANDOM.copy()
    scaled[:, k] *= factor
    np.testing.assert_allclose(ident.unique_shares(scaled), ident.unique_shares(RANDOM), rtol=1e-8)


def test_unique_share_of_a_near_zero_column_is_zero_and_not_scaled_up() -> None:
    columns = np.column_stack([RANDOM, 1e-12 * RNG.normal(size=60)])
    assert ident.unique_shares(columns)[8] == 0.0


def test_near_zero_columns_are_dropped_before_scaling() -> None:
    """Scaled first, rounding errors would pass for a well-conditioned parameter."""
    candidates = np.column_stack([RANDOM, 1e-12 * RNG.normal(size=60)])
    ranking = ident.rank(np.zeros((60, 0)), candidates)
    assert 8 not in ranking.order
    assert ranking.kept(1e12).tolist() == list(range(8))


def test_rank_keeps_one_of_a_pair_and_shows_the_condition_it_takes_for_the_other() -> None:
    nearly = RANDOM[:, 1] + 1e-3 * RANDOM[:, 7] * np.linalg.norm(RANDOM[:, 1]) / np.linalg.norm(RANDOM[:, 7])
    ranking = ident.rank(np.zeros((60, 0)), np.column_stack([RANDOM[:, :3], nearly]))
    assert len(ranking.kept(50.0)) == 3
    assert {0, 2} <= set(ranking.kept(50.0).tolist())
    assert len(ranking.kept(5000.0)) == 4


def test_the_order_decides_which_of_a_pair_is_kept() -> None:
    """Whatever their lengths: the poses do not choose."""
    pair = np.column_stack([RANDOM[:, 0], RANDOM[:, 0] + 1e-6 * RANDOM[:, 1], RANDOM[:, 2]])
    for first, second in ((0, 1), (1, 0)):
        ranking = ident.rank(np.zeros((60, 0)), pair * np.array([1.0, 100.0, 1.0]), np.array([first, second, 2]))
        assert ranking.kept(1e4).tolist() == [first, 2]
    assert ident.rank(np.zeros((60, 0)), pair, np.array([1, 2])).kept(1e4).tolist() == [1, 2]


def test_what_the_fixed_columns_explain_is_never_kept() -> None:
    fixed = RANDOM[:, :4]
    ranking = ident.rank(fixed, np.column_stack([fixed @ [1.0, -2.0, 0.0, 3.0], RANDOM[:, 5]]))
    assert ranking.kept(1e6).tolist() == [1]


def test_the_unit_of_a_column_does_not_decide_its_rank() -> None:
    metres = ident.rank(RANDOM[:, :2], RANDOM[:, 2:])
    mixed = ident.rank(RANDOM[:, :2], RANDOM[:, 2:] * np.array([1e3, 1, 1e-3, 1, 1e2, 1]))
    for limit in (1.02, 1.05, 1.1, 2.0):
        assert metres.kept(limit).tolist() == mixed.kept(limit).tolist()
    assert 0 < len(metres.kept(1.02)) < 6


def test_cross_validation_predicts_each_row_from_the_other_folds() -> None:
    target = RANDOM[:, :3] @ [1.0, 2.0, 3.0]
    fold = np.arange(60) % 5
    assert ident.folded(RANDOM[:, :3], target, fold).squared(np.arange(3)).max() < 1e-24
    noise, chosen = RNG.normal(size=60), np.array([1, 4, 5])
    found = ident.folded(RANDOM, noise, fold).squared(chosen)
    for k in range(5):
        seen, tested = RANDOM[fold != k][:, chosen], RANDOM[fold == k][:, chosen]
        left = noise[fold == k] - tested @ np.linalg.lstsq(seen, noise[fold != k], rcond=None)[0]
        assert found[k] == pytest.approx(np.sum(left**2))


def test_the_curve_has_a_point_for_every_rank_its_limits_give() -> None:
    target = RNG.normal(size=60)
    ranking = ident.rank(RANDOM[:, :2], RANDOM[:, 2:])
    curve = ident.rank_curve(ranking, ident.folded(RANDOM, target, np.arange(60) % 5), 2)
    assert len({c.rank for c in curve}) == len(curve)
    assert curve[-1].rank == 8
    assert all(c.condition_limit in ident.LIMITS and c.cv_rms > 0 for c in curve)
