"""Test ranks, intervals, outliers, rigid motions, tails and allocation of memory."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from gpmodel.numerics import rank as ident
from gpmodel.numerics import se3
from gpmodel.numerics.interval import FREEDOMS, coverage_factor, freedom_of_sum, tails, with_far_ones
from gpmodel.numerics.least_squares import LeaveOneOut, Omitted, give_back, in_company, outlier_limit
from gpmodel.numerics.rank import orthonormal

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


def _pages() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1])


@pytest.mark.skipif(sys.platform != "linux", reason="pages in memory are counted in /proc")
def test_what_many_small_arrays_had_is_given_back() -> None:
    give_back()
    before = _pages()
    several = [np.ones(8_000) for _ in range(2_000)]
    held, last = _pages(), several[-1]
    del several
    give_back()
    assert held - before > 20_000
    assert _pages() - before < 0.2 * (held - before)
    assert last.sum() == 8_000


@pytest.mark.parametrize(("freedom", "factor"), [(4.0, 2.776), (20.0, 2.086), (np.inf, 1.960)])
def test_the_factor_is_that_of_the_guide(freedom: float, factor: float) -> None:
    """Source: JCGM 100 (2008), table G.2."""
    assert coverage_factor(freedom) == pytest.approx(factor, abs=1e-3)


def test_a_sum_has_at_most_the_freedom_of_both_and_at_least_that_of_the_larger() -> None:
    freedoms = np.array([[8.0], [12.0]])
    np.testing.assert_allclose(freedom_of_sum(np.array([[1.0, 1.0], [0.0, 1.0]]), freedoms), [8.0, 19.2])
    assert freedom_of_sum(np.ones((2, 1)), np.full((2, 1), np.inf))[0] == np.inf


def test_intervals_of_few_draws_hold_as_often_as_they_say() -> None:
    drawn = np.random.default_rng(0).normal(size=(20_000, 5))
    sigma = drawn.std(axis=1, ddof=1) / np.sqrt(5.0)
    assert np.mean(np.abs(drawn.mean(axis=1)) < coverage_factor(4.0) * sigma) == pytest.approx(0.95, abs=0.005)


RNG_OUT = np.random.default_rng(3)
COLUMNS = RNG_OUT.normal(size=(40, 6)) * [1.0, 1e-4, 3.0, 1.0, 50.0, 1.0]
COLUMNS[:, 5] = COLUMNS[:, 0] - 2.0 * COLUMNS[:, 3]
VALUES = RNG_OUT.normal(size=(40, 2))


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


twists = st.lists(st.floats(-3.0, 3.0), min_size=6, max_size=6).map(np.array)


@given(twists, st.sampled_from([1.0, 1e-3, 1e-5, 1e-9, 0.0]))
def test_exp_is_the_matrix_exponential(twist: np.ndarray, size: float) -> None:
    twist = size * twist
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[:3, 3] = se3.hat(twist[3:]), twist[:3]
    np.testing.assert_allclose(se3.exp(twist), expm(generator), atol=1e-12)


def test_exp_is_continuous_where_the_series_takes_over() -> None:
    twist = np.array([1.0, -2.0, 0.5, 0.6, 0.0, 0.8])
    twist[3:] *= 1e-4
    below, above = (twist * np.array([1, 1, 1, f, f, f]) for f in (1 - 1e-9, 1 + 1e-9))
    np.testing.assert_allclose(se3.exp(below), se3.exp(above), atol=1e-12)


def test_hat_is_the_cross_product() -> None:
    a, b = np.random.default_rng(0).normal(size=(2, 7, 3))
    np.testing.assert_allclose((se3.hat(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)


def test_rotation_vector_inverts_exp() -> None:
    turns = np.random.default_rng(1).uniform(-1.7, 1.7, (2, 5, 3))
    rotations = se3.exp(np.concatenate([np.zeros_like(turns), turns], axis=-1))[..., :3, :3]
    np.testing.assert_allclose(se3.rotation_vector(rotations), turns, atol=1e-12)


def test_chain_multiplies_from_the_root() -> None:
    a, b, c = se3.exp(np.random.default_rng(2).normal(size=(3, 4, 6)))
    np.testing.assert_allclose(se3.chain(np.stack([a, b, c]))[2], a @ b @ c, atol=1e-12)


@pytest.mark.parametrize("points", [3, 20])
def test_fit_rotation_finds_the_motion_and_never_a_mirror_image(points: int) -> None:
    rng = np.random.default_rng(points)
    source = rng.normal(size=(points, 3))
    motion = se3.exp(rng.normal(size=6))
    turn, shift = se3.fit_rotation(source, source @ motion[:3, :3].T + motion[:3, 3])
    np.testing.assert_allclose(turn, motion[:3, :3], atol=1e-12)
    np.testing.assert_allclose(shift, motion[:3, 3], atol=1e-12)
    mirrored, _ = se3.fit_rotation(source, source * np.array([1.0, 1.0, -1.0]))
    assert np.linalg.det(mirrored) == pytest.approx(1.0)


@pytest.mark.long
@given(twists, st.sampled_from([0.3, 1e-2, 1e-4, 1e-8, 0.0]))
def test_right_jacobian_is_the_whole_series_however_few_of_its_terms_are_summed(twist: np.ndarray, size: float) -> None:
    twist = size * twist
    ad = np.block([[se3.hat(twist[3:]), se3.hat(twist[:3])], [np.zeros((3, 3)), se3.hat(twist[3:])]])
    whole, term = np.eye(6), np.eye(6)
    for k in range(1, 30):
        term = -term @ ad / (k + 1)
        whole = whole + term
    np.testing.assert_allclose(se3.right_jacobian(np.vstack([twist, 0.5 * twist]))[0], whole, atol=1e-12)


@pytest.mark.parametrize("size", [0.0, 1e-6, 0.3, 2.0, 3.1])
def test_a_small_turn_about_the_outer_axes_changes_the_rotation_vector_as_said(size: float) -> None:
    vector = size * np.array([0.6, -0.48, 0.64])
    there = se3.exp(np.concatenate([np.zeros(3), vector]))[:3, :3]
    step = 1e-6
    found = [
        (se3.rotation_vector(se3.exp(np.concatenate([np.zeros(3), s * step * axis]))[:3, :3] @ there))
        for axis in np.eye(3)
        for s in (1, -1)
    ]
    differences = (np.array(found[::2]) - np.array(found[1::2])).T / (2 * step)
    np.testing.assert_allclose(se3.vector_change(vector), differences, atol=1e-6)


@pytest.mark.parametrize("freedom", [3.0, 1000.0])
def test_a_large_sample_tells_its_degrees_of_freedom_and_its_scale(freedom: float) -> None:
    values = 2e-5 * np.random.default_rng(1).standard_t(freedom, 6000)
    found = tails(values, len(values))
    best = int(np.argmax(found.weight))
    assert found.weight.sum() == pytest.approx(1.0)
    assert abs(FREEDOMS.index(FREEDOMS[best]) - FREEDOMS.index(freedom)) <= 1
    assert found.scale[best] == pytest.approx(2e-5, rel=0.05)


def test_what_is_drawn_is_as_wide_and_as_long_tailed_as_the_sample() -> None:
    rng = np.random.default_rng(2)
    drawn = tails(rng.standard_t(4.0, 5000), 5000).drawn((50, 200, 3), rng)
    wanted = rng.standard_t(4.0, drawn.size)
    for level in (50, 90, 99):
        assert np.percentile(np.abs(drawn), level) == pytest.approx(np.percentile(np.abs(wanted), level), rel=0.1)


@pytest.mark.long
def test_the_scale_of_a_small_sample_is_as_unsure_as_samples_differ() -> None:
    rng = np.random.default_rng(3)
    scales = [np.log(tails(rng.normal(size=40), 40).scale[-1]) for _ in range(300)]
    assert np.std(scales) == pytest.approx(tails(rng.normal(size=40), 40).uncertain[-1], rel=0.15)


def test_errors_left_out_are_tails_of_one_distribution_or_failures() -> None:
    rng = np.random.default_rng(4)
    heavy, normal = rng.standard_t(3.0, (200, 3)), rng.normal(size=(200, 3))
    out = np.linalg.norm(heavy, axis=1) > 8.0
    assert out.any()
    share = with_far_ones(heavy[~out], heavy[out], 3 * (~out).sum()).weight
    assert share[: len(FREEDOMS)].sum() > 0.9
    share = with_far_ones(normal, np.array([[60.0, 0.0, 20.0], [-30.0, 40.0, 5.0]]), normal.size).weight
    assert share[: len(FREEDOMS)].sum() < 1e-6


def test_what_a_fit_does_to_tails_is_undone() -> None:
    """Residuals of least squares are sums of many errors and look more normal than these."""
    rng, found = np.random.default_rng(5), []
    for _ in range(12):
        errors, columns = rng.standard_t(3.0, 300), np.linalg.qr(rng.normal(size=(300, 40)))[0]
        leverage = np.sum(columns**2, axis=1)
        left = (errors - columns @ (columns.T @ errors)) / (1.0 - leverage)
        blurs = np.zeros(300), leverage / (1.0 - leverage)
        found.append([np.sum(np.log(FREEDOMS) * tails(left, 260.0, blur).weight) for blur in blurs])
    plain, undone = np.exp(np.mean(found, axis=0))
    assert abs(undone - 3.0) < 0.5 * abs(plain - 3.0)


def test_displacements_without_a_registration_are_the_derivatives_of_its_residual() -> None:
    """At points that a registration fits exactly."""
    rng = np.random.default_rng(3)
    points, columns, step = rng.normal(size=(9, 3)), rng.normal(size=(9, 3, 2)), 1e-6

    def residual(parameters: np.ndarray) -> np.ndarray:
        moved = points + columns @ parameters
        turn, shift = se3.fit_rotation(moved, points)
        return np.asarray(points - moved @ turn.T - shift)

    found = -se3.without_registration(points, columns)
    for k, unit in enumerate(np.eye(2)):
        slope = (residual(step * unit) - residual(-step * unit)) / (2.0 * step)
        np.testing.assert_allclose(found[..., k], slope, atol=1e-8)
