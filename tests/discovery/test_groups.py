"""Groups chosen together: every figure against dense linear algebra, planted robots named, innocent ones left alone."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import NOISE, Truth, bare, measure, mechanism, sized
from scipy import linalg, stats

from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.linearise import linearise
from gpmodel.calibration.noise import Whitening, blocks_of
from gpmodel.discovery.selection.active import Active
from gpmodel.discovery.selection.gain import best, gain
from gpmodel.discovery.selection.group import Shapes, from_candidate, geometry_groups
from gpmodel.discovery.selection.leave_out import left_out
from gpmodel.discovery.selection.pool import Pool
from gpmodel.discovery.selection.refit import normal, whitened
from gpmodel.discovery.selection.result import Selection
from gpmodel.discovery.selection.rows import Rows
from gpmodel.discovery.selection.scan import Replacements, scan
from gpmodel.discovery.selection.select import select
from gpmodel.discovery.selection.standing import GENERIC, PAIRS, Offering, of_offers, offered
from gpmodel.discovery.selection.waves import combs_of, most_by_chance, spectrum
from gpmodel.families import catalogue
from gpmodel.families.comb import Comb
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.geometric import geometric_effects
from gpmodel.table.bundles import replicates

ARM = "irb6400r"
STANDING = (of_offers(catalogue.catalogue), *GENERIC)
PLANTED = ("base compliance", "joint compliance, J3", "gear error, 2 per turn, J4", "coupling, J4 to J5")


def chosen(truth: Truth) -> Selection:
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    return select(calibrate(model, truth.poses), truth.poses, Offering(STANDING, PAIRS), shuffles=19)


@cache
def robot(names: tuple[str, ...], count: int = 90, seed: int = 5) -> Truth:
    """A robot with some catalogue effects of 0.15 mm each, or none."""
    data = bare(ARM, count, seed, payload=False)
    arm = mechanism(ARM)
    pool = {c.name: c for c in catalogue.candidates(arm, prepare(arm, data).states)}
    theta = np.concatenate([np.zeros(0), *(sized(ARM, pool[n].effects, data, 0.15) for n in names)])
    return measure(ARM, [e for n in names for e in pool[n].effects], theta, seed, dataset=data)


@cache
def found() -> Selection:
    return chosen(robot(PLANTED))


@cache
def problem() -> tuple[Active, np.ndarray]:
    """A few groups in, on twenty poses of two each; the target before whitening and projection."""
    data = bare(ARM, 20, 1, payload=False)
    data = replace(data, q=np.repeat(data.q[::2], 2, axis=0))
    truth = measure(ARM, (), (), 1, dataset=data)
    arm, poses = truth.model.mechanism, truth.poses
    model = ErrorModel(arm, geometric_effects(arm))
    linear = linearise(model, poses, np.zeros(len(model.effects)), truth.placement, 1.0, np.ones(len(poses), bool))
    noise = replace(blocks_of(linear, replicates(poses.dataset)), ratio=0.7)
    shapes = Shapes(poses.states)
    groups = [*geometry_groups(model.effects), *offered(STANDING, arm, shapes)[::40]]
    target = linear.residual + np.random.default_rng(0).normal(0, 1e-4, len(linear.residual))
    active = Active(Pool(Rows(arm, linear, target, noise, shapes), groups), {}, {}, 4e-10)
    for g, a in ((0, 1e-6), (1, 1e-6), (5, 1e-8), (9, 1e-9)):
        active = active.added(g, a)
    return active, target


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
    return float(density.logpdf(free @ target)) - sum(active.pool.cost[g] for g in active.variances)


def test_the_evidence_is_the_density_of_the_target() -> None:
    active, target = problem()
    assert active.evidence == pytest.approx(dense(active, target), abs=1e-3)


def test_the_gain_of_a_group_is_what_the_density_gains_with_it() -> None:
    active, target = problem()
    gains, variances = scan(active)
    some = [g for g in range(2, len(gains)) if g not in active.variances][::7]
    for g in some:
        there = active.added(g, float(variances[g]))
        assert gains[g] - active.pool.cost[g] == pytest.approx(dense(there, target) - dense(active, target), abs=1e-3)
    short, _ = scan(active, np.array(some))
    np.testing.assert_allclose(short[some], gains[some], atol=1e-6)
    assert np.isneginf(np.delete(short, some)).all()


def test_a_group_in_the_model_is_worth_what_the_density_loses_without_it() -> None:
    active, target = problem()
    worth, variance = active.worth(9)
    there = replace(active, variances={**active.variances, 9: variance})
    lost = dense(there, target) - dense(active.without(9), target)
    assert worth - active.pool.cost[9] == pytest.approx(lost, abs=1e-3)


def test_a_group_in_place_of_another_gains_what_the_density_says() -> None:
    active, target = problem()
    gains, variances = Replacements(active).of(5, -1.0)
    for g in [g for g in range(2, len(gains)) if g not in active.variances][::9]:
        there = active.without(5).added(g, float(variances[g]))
        gained = dense(there, target) - dense(active.without(5), target)
        assert gains[g] - active.pool.cost[g] == pytest.approx(gained, abs=1e-3)


def test_no_variance_on_a_fine_grid_beats_the_best() -> None:
    rng = np.random.default_rng(0)
    s, q = rng.gamma(1.0, 1e8, (50, 4)), rng.normal(0, 3e4, (50, 4))
    gains, _ = best(s, q, np.full(50, 5e-3))
    fine = gain(np.tile(np.geomspace(1e-15, 2.5e-5, 3000), (50, 1)), s, q)
    assert (gains >= fine.max(axis=1) * (1 - 2e-4) - 1e-3).all()


def test_four_effects_at_once_are_named_and_nothing_else() -> None:
    assert {k.group.name for k in found().kept} == set(PLANTED)
    assert found().noise == pytest.approx(NOISE, rel=0.15)


def test_the_values_found_are_the_true_ones_within_their_deviations() -> None:
    truth = robot(PLANTED)
    true = dict(zip((e.terms for e in truth.model.effects), truth.theta, strict=True))
    pulls = [
        (v - true[e.terms]) / s
        for k in found().kept
        for e, v, s in zip(k.group.effects, k.values, k.stderr, strict=True)
    ]
    assert np.max(np.abs(pulls)) < 3.5


@pytest.mark.parametrize("seed", range(3))
def test_an_innocent_robot_gets_nothing(seed: int) -> None:
    assert chosen(robot((), 60, seed)).kept == ()


@pytest.mark.parametrize("jitter", [0.0, 5e-5])
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
    assert selection.pose_noise == pytest.approx(4e-5, rel=0.3)


def test_one_pose_far_out_is_an_outlier_and_no_law() -> None:
    truth = robot(PLANTED[:1])
    position = truth.poses.dataset.position.copy()
    position[84] += 1.5e-3
    data = replace(truth.poses.dataset, position=position)
    selection = chosen(replace(truth, poses=prepare(truth.model.mechanism, data)))
    assert selection.outliers.tolist() == [84]
    assert [k.group.name for k in selection.kept] == [PLANTED[0]]


def test_a_pose_left_out_is_missed_as_a_fit_without_it_misses_it() -> None:
    fit, poses = found().fit, robot(PLANTED).poses
    bundle = np.arange(len(poses)) // 2
    prior = np.array([e.prior for e in fit.point.model.effects])
    total = fit.problem.residual + fit.problem.columns[:, fit.problem.placement :] @ fit.point.theta
    out = left_out(fit, bundle)
    for b in (3, 17):
        own = bundle[fit.problem.pose_of_row] == b
        system = normal(fit.problem, fit.whitening, prior, fit.sigma)
        kept = system.columns[~own]
        inner = kept.T @ kept + np.diag(system.pull**2 + 1e-12)
        missed = total[own] - system.columns[own] @ np.linalg.solve(inner, kept.T @ total[~own])
        assert out[bundle == b].sum() == pytest.approx(float(missed @ missed), rel=1e-6)


def test_without_a_true_effect_left_out_poses_are_missed_by_more() -> None:
    fit = found().fit
    bundle = np.arange(len(fit.error))
    names = [e.name for k in found().kept[:1] for e in k.effects]
    assert left_out(fit, bundle, names).mean() > 1.5 * left_out(fit, bundle).mean()


def test_whitening_makes_the_two_levels_one() -> None:
    block = np.array([0, 0, 0, 1, 2, 2])
    noise = Whitening(block, 0.8)
    covariance = np.eye(6) + 0.8 * (block[:, None] == block)
    half = noise.whiten(np.eye(6))
    np.testing.assert_allclose(half @ covariance @ half.T, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(noise.restored(half), np.eye(6), atol=1e-12)


def test_the_ratio_of_the_levels_is_recovered() -> None:
    rng = np.random.default_rng(0)
    block = np.repeat(np.arange(600), 3)
    values = rng.normal(size=1800) + 1.5 * rng.normal(size=600)[block]
    assert Whitening(block).estimated(values, 0.0).ratio == pytest.approx(2.25, rel=0.15)


def test_a_problem_without_repeats_has_one_level_of_noise() -> None:
    fit = found().fit
    assert whitened(fit.problem, np.arange(len(fit.error)), 0.0).estimated(fit.problem.residual, 80.0).ratio == 0.0


def combs(arm: str) -> list[Comb]:
    return combs_of(
        catalogue.catalogue, mechanism(arm), prepare(mechanism(arm), bare(arm, 20, 1, payload=False)).states
    )


def test_a_wave_is_worth_what_its_group_is() -> None:
    active, _ = problem()
    rows = active.pool.rows
    for comb in combs(ARM)[1:4]:
        there = spectrum(active, comb, rows.target[:, None])
        for rate in (7.0, 101.37, 250.5):
            group = from_candidate(comb.at(rate), rows.shapes)
            assert group is not None
            pool = Pool(rows, [*active.pool.groups, replace(group, spreads=(1.0, 1.0))])
            beside = Active(pool, active.variances, active.chosen, active.sigma2)
            assert there.gain(rate) == pytest.approx(scan(beside)[0][-1], rel=1e-6, abs=1e-9)


def test_waves_of_noise_are_worth_nothing_once_all_rates_are_paid_for() -> None:
    active, _ = problem()
    noise = np.random.default_rng(1).normal(0, np.sqrt(active.sigma2), (len(active.pool.rows.target), 400))
    assert np.mean(most_by_chance(active, combs(ARM), active.pool.rows.clean(noise)) > 0.0) < 0.05


@pytest.mark.parametrize("rate", [37.42, 101.4, 160.0])
def test_a_ripple_at_any_number_per_turn_is_found_and_named(rate: float) -> None:
    data = bare(ARM, 90, 5, payload=False)
    ripple = combs(ARM)[1].at(rate).effects
    truth = measure(ARM, ripple, sized(ARM, ripple, data, 0.1), 5, dataset=data)
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    selection = select(calibrate(model, truth.poses), truth.poses, Offering(STANDING, combs=combs(ARM)), shuffles=9)
    (kept,) = selection.kept
    said = re.fullmatch(r"transmission ripple, ([\d.]+) per turn, (\w+)", kept.group.name)
    assert said
    assert float(said[1]) == pytest.approx(rate, abs=0.2)
    assert said[2] == combs(ARM)[1].joint.name
