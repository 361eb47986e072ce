"""Test the score of a candidate against plain least squares."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import MECHANISMS, bare, first_of_each_family, measure, mechanism, sized
from residual_cases import NAMES, best_nats, pool, seen

import gpmodel as gp
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on
from gpmodel.discovery.targets import targets
from gpmodel.evidence.criteria import Criteria
from gpmodel.evidence.cross_validation import better_by, cross_validated
from gpmodel.evidence.residual import residual_of
from gpmodel.evidence.score import mdl_gain, scores
from gpmodel.evolution.chance import chance_of
from gpmodel.families import catalogue
from gpmodel.families.candidate import Candidate
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import effect_at
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects, sites_of
from gpmodel.numerics.least_squares import outlier_limit
from gpmodel.numerics.rank import orthonormal
from gpmodel.table.blocks import folds


@pytest.mark.long
@pytest.mark.parametrize("planted", NAMES)
def test_the_planted_effect_scores_best_or_its_column_is_that_of_the_best(planted: str) -> None:
    there, candidates = seen(planted), pool()
    best = candidates[int(np.argmax([s.nats for s in scores(there, candidates)]))]
    own = next(c for c in candidates if c.name == planted)
    spans = [orthonormal(there.projected(c.effects)[0]) for c in (best, own)]
    assert np.linalg.norm(spans[0].T @ spans[1], 2) > 0.95


@pytest.mark.long
@pytest.mark.parametrize("planted", NAMES)
def test_the_planted_effect_stands_out_of_shuffled_residuals(planted: str) -> None:
    there, candidates = seen(planted), pool()
    null = best_nats(there, candidates, there.permuted(np.random.default_rng(0), 60))
    assert chance_of(max(s.nats for s in scores(there, candidates)), null).p < 0.01


@pytest.mark.long
def test_nothing_stands_out_of_an_innocent_robot() -> None:
    there = seen("nothing")
    null = best_nats(there, pool(), there.permuted(np.random.default_rng(0), 60))
    assert chance_of(max(s.nats for s in scores(there, pool())), null).p > 0.05


def test_the_best_of_all_is_that_of_each_residual_by_itself() -> None:
    there, candidates = seen(NAMES[0]), pool()[::5]
    trials = there.permuted(np.random.default_rng(3), 3)
    one_by_one = [max(s.nats for s in scores(replace(there, values=trial), candidates)) for trial in trials.T]
    np.testing.assert_allclose(best_nats(there, candidates, trials), one_by_one, rtol=1e-6)


def test_a_gain_is_the_share_of_the_squares_that_least_squares_removes() -> None:
    there = seen(NAMES[1])
    plain = [c for c in pool() if not c.has_priors][::17]
    columns = there.problem.columns[:, np.append(np.ones(there.problem.placement, bool), there.calibration.free)]
    for candidate, score in zip(plain, scores(there, plain), strict=True):
        if np.isfinite(score.nats):
            both = np.hstack([columns, there.columns(candidate.effects)])
            both = both / np.linalg.norm(both, axis=0)
            left = there.problem.residual - both @ np.linalg.lstsq(both, there.problem.residual, rcond=1e-12)[0]
            assert score.gain == pytest.approx(1 - left @ left / there.energy, abs=1e-6)


def test_columns_are_projected_off_all_that_is_enabled() -> None:
    there = seen(NAMES[0])
    left, shares = there.projected([e for c in pool()[:60] for e in c.effects])
    assert np.abs(there.span.basis.T @ left).max() < 1e-9
    np.testing.assert_allclose(np.linalg.norm(left, axis=0), shares, atol=1e-12)
    assert ((shares >= 0) & (shares <= 1 + 1e-12)).all()


def test_what_the_model_already_has_scores_nothing_and_neither_does_what_is_not_finite() -> None:
    there = seen(NAMES[0])
    enabled = effect_at("again", "J3.moving", "Ry")
    infinite = effect_at("infinite", "J3.moving", "Ry", Expression("1/(J1 - J1)"))
    for effect in (enabled, infinite):
        (score,) = scores(there, [Candidate(effect.name, (effect,), "", 4.0)])
        assert score.nats == -np.inf
        assert score.gain == 0.0


def test_a_description_pays_for_its_unknowns_and_for_what_it_was_chosen_from() -> None:
    there = seen(NAMES[0])
    assert mdl_gain(there, 0.2, 1, 4.0) > mdl_gain(there, 0.2, 2, 4.0) > mdl_gain(there, 0.2, 2, 6.0)
    assert mdl_gain(there, 0.0, 1, 4.0) < 0
    assert np.isfinite(mdl_gain(there, 1.0, 1, 4.0))


@pytest.mark.parametrize("name", [NAMES[0], NAMES[1]])
def test_cross_validation_is_a_refit_without_each_fold(name: str) -> None:
    there = seen(name)
    effects = next(c.effects for c in pool() if c.name == name)
    found = cross_validated(there, effects)
    columns = np.hstack([there.system, there.columns(effects) / np.linalg.norm(there.columns(effects), axis=0)])
    expected = np.zeros(90)
    for fold in np.unique(there.fold_of_row):
        test = there.fold_of_row == fold
        solved = np.linalg.lstsq(columns[~test], there.target[~test], rcond=None)[0]
        np.add.at(expected, there.problem.pose_of_row[test], (there.target[test] - columns[test] @ solved) ** 2)
    np.testing.assert_allclose(found.per_unit, expected, rtol=1e-5, atol=1e-16)
    assert found.rms == pytest.approx(np.sqrt(expected.mean()))
    assert found.coefficients.shape == (len(np.unique(there.fold_of_row)), len(effects))
    assert found.rms < cross_validated(there, ()).rms


def test_better_by_is_the_paired_deviation_of_squared_errors() -> None:
    there = seen(NAMES[1])
    own, other = (next(c.effects for c in pool() if c.name == name) for name in (NAMES[1], NAMES[0]))
    both = [cross_validated(there, effects).per_unit for effects in (other, own)]
    far = outlier_limit(np.sqrt(both[0]), 6.0) ** 2
    gain = np.minimum(both[0], far) - np.minimum(both[1], far)
    expected = gain.mean() / (gain.std(ddof=1) / np.sqrt(len(gain)))
    assert better_by(there, own, other) == pytest.approx(expected)
    assert better_by(there, own) > 2 > better_by(there, other)
    assert better_by(there, own, own) == 0.0


def test_the_gps_view_of_the_problem_is_the_same_problem() -> None:
    there = seen(NAMES[1])
    sites = sites_of(mechanism("irb6400r"))
    seen_by_gp = targets(there, sites, np.arange(90))
    for text in ("sin(2*J4)", "torque_J2", "x*y"):
        basis = Expression(text)
        columns = basis(there.poses.states)[None]
        gains = [seen_by_gp.gains(columns, k)[0] for k in range(seen_by_gp.sites)]
        scored = scores(there, [Candidate("c", (s.effect("e", basis, "1"),), "", 0.0) for s in sites])
        np.testing.assert_allclose(gains, [s.gain for s in scored], rtol=1e-6, atol=1e-9)


def test_shuffling_keeps_the_poses_whole_and_the_model_out() -> None:
    there = seen(NAMES[0])
    order = there.permuted(np.random.default_rng(0), 5)
    assert np.abs(there.span.basis.T @ order).max() < 1e-12
    assert (np.abs(there.values @ order) < 0.5 * there.energy).all()
    again = there.permuted(np.random.default_rng(0), 5)
    np.testing.assert_array_equal(order, again)


def test_a_far_out_pose_is_winsorised_and_not_dropped() -> None:
    truth = measure("irb6400r", (), (), 5, count=80)
    position = truth.poses.dataset.position.copy()
    position[7] += 5e-3
    poses = prepare(truth.model.mechanism, replace(truth.poses.dataset, position=position))
    fit = calibrate(ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism)), poses)
    there = residual_of(fit, poses, Criteria(), 0)
    shorter = np.abs(there.target[: there.measured]) < np.abs(there.problem.residual)
    assert set(there.problem.pose_of_row[shorter]) == {7}
    assert set(there.problem.pose_of_row) == set(range(80))
    length = np.sqrt(np.bincount(there.problem.pose_of_row, there.target[: there.measured] ** 2))
    assert 3e-5 < length[7] < 1e-3
    trusted = residual_of(fit, poses, Criteria(), 0, trusted=np.ones(80, dtype=bool))
    np.testing.assert_array_equal(trusted.target[: trusted.measured], trusted.problem.residual)
    assert trusted.energy > 10 * there.energy


def test_an_effect_given_back_is_found_again() -> None:
    data = bare("irb6400r", 90, 5)
    effects = first_of_each_family("irb6400r")["gear_harmonic"].effects
    truth = measure("irb6400r", effects, sized("irb6400r", effects, data, 0.3), 5, dataset=data)
    fit = calibrate(
        ErrorModel(truth.model.mechanism, (*geometric_effects(truth.model.mechanism), *effects)), truth.poses
    )
    candidate = Candidate("again", effects, "gear_harmonic", 4.0)
    (without,) = scores(residual_of(fit, truth.poses, Criteria(), 0).without(effects), [candidate])
    assert without.nats > 100
    (enabled,) = scores(residual_of(fit, truth.poses, Criteria(), 0), [candidate])
    assert enabled.nats == -np.inf


def test_what_is_believed_of_the_rest_holds_without_a_large_effect() -> None:
    """An eccentricity of J2 believed to be a tenth of a milliradian: without the spring there it would be seven."""
    data, arm = bare("irb6400r", 40, 5), mechanism("irb6400r")
    spring, circle = (
        catalogue.build(name, arm, prepare(arm, data).states)
        for name in ("joint_compliance J2", "eccentricity J2")
    )  # fmt: skip
    truth = measure("irb6400r", spring, sized("irb6400r", spring, data, 1.0), 5, dataset=data)
    believed = tuple(replace(e, prior=1e-4) for e in circle)
    model = ErrorModel(arm, (*geometric_effects(arm), *believed, *spring))
    whole = residual_of(calibrate(model, truth.poses), truth.poses, Criteria(), 0)
    assert whole.with_refitted_noise() is whole
    without = whole.without(spring)
    found = without.with_refitted_noise()
    assert found.noise == pytest.approx(found.sigma, rel=0.01)
    weighed = np.where(np.arange(len(found.values)) < found.measured, 1.0, found.noise / without.noise)[:, None]
    system, target = without.system * weighed, without.target * weighed[:, 0]
    left = target - system @ np.linalg.lstsq(system, target, rcond=1e-12)[0]
    np.testing.assert_allclose(found.values, left, atol=1e-9)
    assert cross_validated(found, ()).rms > 1.5 * cross_validated(without, ()).rms


@pytest.mark.parametrize("name", MECHANISMS)
def test_sites_are_the_base_every_axis_of_every_joint_and_the_tool(name: str) -> None:
    arm = mechanism(name)
    sites = sites_of(arm)
    assert len({s.terms for s in sites}) == len(sites)
    fixed = [s for s in sites if s.slot.endswith(".fixed")]
    assert len(sites) - len(fixed) == 6 + 6 * sum(slot.endswith(".moving") for slot in arm.slots) + 3
    steps = dict(zip(arm.slots, arm.transforms(np.zeros((1, len(arm.joints))))[:, 0], strict=True))
    for site in fixed:  # none is an axis of the frame before it: one twist there has two components or more
        across, lever = steps[site.slot][:3, "xyz".index(site.axis[1])], steps[site.slot][:3, 3]
        before = np.append(across, np.cross(lever, across) if site.axis[0] == "R" else np.zeros(3))
        assert np.sum(np.abs(before) > 1e-9) > 1
    for joint in arm.joints:
        assert joint.drive in [s.terms for s in sites]


@pytest.mark.long
@pytest.mark.parametrize("instrument", ["planes", "points"])
def test_a_machine_that_shrinks_to_a_point_explains_no_gaps(instrument: str) -> None:
    """Where no reading shows size: what fits to other poses leave is what the one factorisation says."""
    made = gp.simulate("ur5", ["joint_compliance shoulder_lift_joint=1e-5 rad/Nm"], poses=120, instrument=instrument,
                       geometry_sigma="0.3 mm", seed=4)  # fmt: skip
    arm, poses = made.truth.mechanism, prepare(made.truth.mechanism, made.table)
    fit = calibrate(ErrorModel(arm, geometric_effects(arm)), poses)
    residual = residual_of(fit, poses, Criteria(), 0)
    assert residual.rms == pytest.approx(np.sqrt(np.mean(fit.error**2)), rel=0.05)
    assert residual.freedom <= residual.measured - residual.span.size + 1
    fold, errors = folds(poses.dataset, Criteria().folds, np.random.default_rng(0)), np.zeros(len(poses))
    for k in range(Criteria().folds):
        seen, held = poses.subset(np.flatnonzero(fold != k)), poses.subset(np.flatnonzero(fold == k))
        again = calibrate(fit.model, seen, condition_limit=fit.condition_limit)
        errors[fold == k] = errors_on(again, held)
    assert cross_validated(residual, ()).rms == pytest.approx(np.sqrt(np.mean(errors**2)), rel=0.2)
