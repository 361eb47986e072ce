"""Test the joint selection against dense linear algebra, and on robots with and without effects."""

from dataclasses import replace
from functools import cache

import loop_cases
import numpy as np
import pytest
from effect_cases import MECHANISMS, NOISE, Truth, bare, measure, mechanism, sized
from group_cases import ARM, STANDING, offered, offering, problem
from scipy import linalg, stats

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.noise import Whitening
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.score import with_refitted_noise
from gpmodel.families import catalogue
from gpmodel.families.catalogue import explained
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.selection.causes import credible_set
from gpmodel.selection.group import FEW, Price, Shapes
from gpmodel.selection.offers import Offering
from gpmodel.selection.posterior import LEAST, Active
from gpmodel.selection.result import Selection
from gpmodel.selection.scan import Scan, beside_curves, whole
from gpmodel.selection.select import select
from gpmodel.selection.sparse_bayes import reestimate

PLANTED = ("base compliance", "joint compliance, J3", "gear error, 2 per turn, J4", "coupling, J4 to J5")


def chosen(truth: Truth) -> Selection:
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    asked = offering(truth.model.mechanism, truth.poses)
    return select(calibrate(model, truth.poses), truth.poses, asked, prices=Price(Criteria(shuffles=19)))


@cache
def robot(names: tuple[str, ...], count: int = 90, seed: int = 5) -> Truth:
    """A robot with some catalogue effects of 0.15 mm each, or none."""
    data = bare(ARM, count, seed, payload=False)
    arm = mechanism(ARM)
    pool = {c.name: c for c in catalogue.candidates(arm, prepare(arm, data).states)}
    theta = np.concatenate([np.zeros(0), *(sized(ARM, pool[n].effects, data, 0.15) for n in names)])
    return measure(ARM, [e for n in names for e in pool[n].effects], theta, seed, dataset=data)


@cache
def found(count: int = 90, seed: int = 5) -> Selection:
    return chosen(robot(PLANTED, count, seed))


def dense(active: Active, target: np.ndarray) -> float:
    """Log density of the target in the complement of the placement, with nothing but full matrices."""
    rows = active.pool.rows
    covariance = np.zeros((len(target), len(target)))
    for block in np.unique(rows.whitening.block):
        own = rows.whitening.block == block
        covariance[np.ix_(own, own)] = rows.whitening.ratio * active.sigma2
    covariance += active.sigma2 * np.eye(len(target))
    for g, a in active.variances.items():
        columns = rows.columns(active.pool.groups[g].effects) * np.array(active.pool.groups[g].spreads)
        covariance += a * columns @ columns.T
    whiten = rows.whitening.whiten(np.eye(len(target)))
    free = linalg.null_space(rows.placement.T).T @ whiten
    density = stats.multivariate_normal(cov=free @ covariance @ free.T, allow_singular=True)
    return float(density.logpdf(free @ target))


def scaled(active: Active, factor: float) -> Active:
    """Return the model with the noise and all variances multiplied by a factor."""
    variances = {g: factor * a for g, a in active.variances.items()}
    return replace(active, variances=variances, sigma2=factor * active.sigma2)


def test_the_evidence_is_the_density_of_the_target() -> None:
    active, target = problem()
    assert active.evidence == pytest.approx(dense(active, target), abs=1e-3)


def test_the_gain_of_a_group_is_what_the_density_gains_with_it() -> None:
    active, target = problem()
    gains, variances, _ = Scan(active).gains()
    some = [g for g in range(2, len(gains)) if g not in active.variances][::7]
    for g in some:
        there = active.added(g, float(variances[g]))
        assert gains[g] == pytest.approx(dense(there, target) - dense(active, target), abs=1e-3)
    short, *_ = Scan(active, np.array(some)).gains()
    np.testing.assert_allclose(short[some], gains[some], atol=1e-6)
    assert np.isneginf(np.delete(short, some)).all()


def test_at_its_own_noise_a_group_gains_what_the_density_does_once_everything_is_scaled_to_what_is_left() -> None:
    active, target = problem()
    active = scaled(active, active.mismatch / active.pool.rows.freedom)
    gains, variances, fit = Scan(active).gains()
    gains = with_refitted_noise(gains, fit, active.mismatch)
    for g in [g for g in range(2, len(gains)) if g not in active.variances][::9]:
        there = scaled(active.added(g, float(variances[g])), 1.0 - fit[g] / active.mismatch)
        assert gains[g] == pytest.approx(dense(there, target) - dense(active, target), abs=1e-3)


def test_a_group_in_the_model_is_worth_what_the_density_loses_without_it() -> None:
    active, target = problem()
    worth, variance = active.gains[9]
    there = replace(active, variances={**active.variances, 9: variance})
    lost = dense(there, target) - dense(active.without(9), target)
    assert worth == pytest.approx(lost, abs=1e-3)


def test_beside_held_curves_a_model_is_worth_what_it_is_with_them_among_the_others() -> None:
    """Objective, residual and gains, before and after a change of another group and of the noise."""
    active, _ = problem()
    many = np.flatnonzero(active.pool.sizes > FEW).tolist()
    curves = [g for g in many if not active.pool.groups[g].always_included and g not in active.variances][:2]
    other = next(g for g in range(2, len(active.pool.groups)) if active.pool.sizes[g] <= FEW and g not in active.found)
    model = reestimate(active.added(curves[0], 1e-6).added(curves[1], 1e-7))
    held = beside_curves(model, (), {})
    assert set(model.variances) - set(held.variances) >= set(curves)
    one_moves = beside_curves(model, curves[:1], {})
    assert set(one_moves.variances) == {*held.variances, curves[0]}
    for part in (held, one_moves, scaled(held.without(5).added(other, 1e-8), 0.9)):
        again = whole(part)
        assert set(again.variances) >= {*part.variances, *curves}
        assert part.objective == pytest.approx(again.objective, abs=1e-6)
        assert part.utility == pytest.approx(again.utility, abs=1e-6)
        np.testing.assert_allclose(part.misfit, again.misfit, rtol=1e-6, atol=1e-9)
        others = [g for g in range(len(active.pool.groups)) if g not in again.variances]
        for now, expected in zip(Scan(part).gains(), Scan(again).gains(), strict=True):
            np.testing.assert_allclose(now[others], expected[others], rtol=1e-4, atol=1e-4)
        assert not np.isfinite(part.prices[curves[1]])


def test_below_its_least_a_gain_is_bounded_from_above() -> None:
    active, _ = problem()
    exact, least = Scan(active).gains()[0], np.full(len(active.pool.groups), 8.0)
    bounded = Scan(active).gains(least)[0]
    np.testing.assert_allclose(bounded[exact >= least], exact[exact >= least])
    assert (bounded >= exact - 1e-9).all()
    assert (bounded != exact).any()


def test_no_other_variance_has_more_evidence_than_a_reestimated_one() -> None:
    active = reestimate(problem()[0])
    for g, a in active.variances.items():
        if a < 0.99 * active.pool.cap[g] ** 2:
            for factor in (0.7, 1.4):
                other = replace(active, variances={**active.variances, g: factor * a})
                assert other.evidence < active.evidence + 0.05


def test_the_variance_of_a_group_that_explains_nothing_stays_above_its_least() -> None:
    active, _ = problem()
    g = next(g for g, index in enumerate(active.pool.index) if len(index) > 2 and g not in active.variances)
    there = active.added(g, 1e-200)
    assert there.reestimated[g] == pytest.approx(LEAST * active.pool.cap[g] ** 2, abs=0.0)
    assert reestimate(there).evidence >= there.evidence


@pytest.mark.long
def test_four_effects_at_once_are_named_and_nothing_else() -> None:
    assert {k.group.name for k in found().kept} == set(PLANTED)
    assert found().state.sigma == pytest.approx(NOISE, rel=0.15)


@pytest.mark.long
@pytest.mark.parametrize(
    "drawn", [{}, *(pytest.param({"count": 80, "seed": s}, marks=pytest.mark.long) for s in (1, 2))]
)
def test_of_two_that_explain_the_same_the_better_known_is_named_and_the_other_on_its_line(drawn: dict) -> None:
    """The first joint of this arm stands on its base: what bends the one tilts the other."""
    selection = found(**drawn)
    assert "joint bending, J1" not in selection.names
    model = selection.active
    (base,) = (g for g in model.found if model.pool.groups[g].name == "base compliance")
    (own,) = (cause for cause in credible_set(model, base).causes if cause.own)
    assert {group.name for group in own.groups} == {"base compliance", "joint bending, J1"}


def test_the_values_found_are_the_true_ones_within_their_deviations() -> None:
    truth = robot(PLANTED)
    true = dict(zip((e.terms for e in truth.model.effects), truth.theta, strict=True))
    chosen_terms = {e.terms for k in found().kept for e in k.group.effects}
    model = found().state.fitting.model
    fit = calibrate(model, truth.poses)
    told = zip(model.effects, fit.theta, fit.stderr, strict=True)
    pulls = [(v - true[e.terms]) / s for e, v, s in told if e.terms in chosen_terms]
    assert len(pulls) == len(chosen_terms)
    assert np.max(np.abs(pulls)) < 3.5


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))])
def test_an_innocent_robot_gets_nothing(seed: int) -> None:
    assert chosen(robot((), 60, seed)).kept == ()


@pytest.mark.long
def test_an_exact_table_gets_nothing_for_its_rounding() -> None:
    truth = measure(ARM, (), (), 1, dataset=bare(ARM, 60, 1, payload=False), noise=0.0)
    assert chosen(truth).kept == ()


@pytest.mark.long
@pytest.mark.parametrize("jitter", [0.0, pytest.param(5e-5, marks=pytest.mark.long)])
def test_repeats_of_an_innocent_robot_add_nothing(jitter: float) -> None:
    rng = np.random.default_rng(3)
    data = bare("ur5", 60, 3, payload=False)
    data = data.subset(np.repeat(np.arange(60), 3))
    truth = measure("ur5", (), (), 3, dataset=replace(data, row=np.arange(1, 181)), noise=1e-5)
    common = np.repeat(rng.normal(0, 4e-5, (60, 3)), 3, axis=0)
    shaken = truth.poses.dataset.q + rng.normal(0, jitter, truth.poses.dataset.q.shape) if jitter else data.q
    seen = replace(truth.poses.dataset, position=truth.poses.dataset.position + common, q=shaken)
    selection = chosen(replace(truth, poses=prepare(truth.model.mechanism, seen)))
    assert selection.kept == ()
    assert np.sqrt(selection.state.fitting.ratio) * selection.state.sigma == pytest.approx(4e-5, rel=0.3)


@pytest.mark.long
@pytest.mark.parametrize("name", MECHANISMS)
def test_every_group_has_a_name_of_its_own_and_constants_in_it_their_unit(name: str) -> None:
    arm = mechanism(name)
    groups = offered(Offering(STANDING), arm, Shapes(prepare(arm, bare(name, 120, in_order=True)).states))
    names = [group.name for group in groups]
    assert len(set(names)) == len(names)
    assert f"warm-up of the zero within 11.9 rows, {arm.joints[0].name}" in names


@pytest.mark.long
def test_one_pose_far_out_is_an_outlier_and_no_law() -> None:
    truth = robot(PLANTED[:1])
    position = truth.poses.dataset.position.copy()
    position[84] += 1.5e-3
    data = replace(truth.poses.dataset, position=position)
    selection = chosen(replace(truth, poses=prepare(truth.model.mechanism, data)))
    assert np.flatnonzero(~selection.state.fitting.use).tolist() == [84]
    assert [k.group.name for k in selection.kept] == [PLANTED[0]]


@pytest.mark.long
def test_a_set_up_that_creeps_and_comes_back_in_part_drifts_along_a_parabola() -> None:
    """Half a sine along the rows is within 4 % of one; a wander of eighteen numbers would be said before."""
    data = bare(ARM, 90, 5, payload=False)
    shapes = (Expression("row/90"), Expression("sin(3.14159*row/90)"))
    creep = [effect_at(f"creep {a}, {k}", "base", a, s, "m") for k, s in enumerate(shapes) for a in ("Tx", "Ty", "Tz")]
    truth = measure(ARM, creep, 1e-4 * np.array([0.6, -0.4, 0.2, 0.8, 1.0, -0.5]), 5, dataset=data)
    assert [k.group.name for k in chosen(truth).kept] == ["drift of the set-up, bent"]


@pytest.mark.long
def test_poses_that_stand_out_of_the_standard_model_come_back_into_the_one_that_explains_them() -> None:
    """Few poses at the ends of a saturating wind-up show that it is no spring."""
    truth, train, _ = loop_cases.robot("windup", 2)
    truth = replace(truth, poses=truth.poses.subset(train))
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    assert len(calibrate(model, truth.poses).outliers) == 4
    selection = chosen(truth)
    assert selection.state.fitting.use.all()
    assert selection.kept
    assert {name for kept in selection.kept for name in kept.group.inputs} == {"torque_J3"}


def test_whitening_makes_the_two_levels_one() -> None:
    block = np.array([0, 0, 0, 1, 2, 2])
    noise = Whitening(block, 0.8)
    covariance = np.eye(6) + 0.8 * (block[:, None] == block)
    half = noise.whiten(np.eye(6))
    np.testing.assert_allclose(half @ covariance @ half.T, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(noise.unwhiten(half), np.eye(6), atol=1e-12)


def test_the_ratio_of_the_levels_is_recovered() -> None:
    rng = np.random.default_rng(0)
    block = np.repeat(np.arange(600), 3)
    values = rng.normal(size=1800) + 1.5 * rng.normal(size=600)[block]
    assert Whitening(block).estimated(values, 0.0).ratio == pytest.approx(2.25, rel=0.15)


def test_a_problem_without_repeats_has_one_level_of_noise() -> None:
    assert found().state.fitting.ratio == 0.0


@pytest.mark.long
@pytest.mark.parametrize("name", MECHANISMS)
def test_everything_a_search_is_offered_is_of_a_family_that_says_what_it_is_and_who_says_so(name: str) -> None:
    arm = mechanism(name)
    groups = offered(Offering(STANDING), arm, Shapes(prepare(arm, bare(name, 120, in_order=True)).states))
    assert len({g.family for g in groups}) > 10
    assert {g.family for g in groups if not explained(g.family)} == set()
