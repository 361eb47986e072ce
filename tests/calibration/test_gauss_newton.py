"""Test the Gauss-Newton fit and its standard errors."""

from dataclasses import replace

import numpy as np
import pytest
from effect_cases import NOISE, Truth, bare, measure, mechanism, residuals, true_tips

import gpmodel as gp
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.iterate import STEP_TOLERANCE, Fitting, iterate
from gpmodel.calibration.linearise import Weighting, linearise
from gpmodel.calibration.priors import GEOMETRY_REACH, fit_priors
from gpmodel.calibration.result import errors_on
from gpmodel.calibration.start import placement_after
from gpmodel.errors import InputError
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import Effect, drive_effect, effect_at
from gpmodel.model.error_model import ErrorModel, Placement, Poses, observe, pose_error, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.table.blocks import sharing

SEEN = {"position": ("position",), "pose": ("position", "rotation"), "distance": ("distance",)}


def few(name: str) -> tuple[Effect, ...]:
    """Effects that no registration or tool can pass for."""
    joints = mechanism(name).joints
    return (
        drive_effect("zero 3", joints[2], Expression("1")),
        drive_effect("zero 4", joints[3], Expression("1")),
        drive_effect("sin", joints[3], Expression(f"sin(2*{joints[3].name})")),
        drive_effect("cos", joints[3], Expression(f"cos(2*{joints[3].name})")),
        effect_at("drift", "base", "Ry", Expression("row/50")),
    )


def fitted(see: str, seed: int, name: str = "ur5", count: int = 50) -> tuple[Truth, object]:
    theta = 1e-3 * np.random.default_rng(seed).normal(size=5)
    truth = measure(name, few(name), theta, seed, count=count, geometry=0.0, see=SEEN[see])
    return truth, calibrate(truth.model, truth.poses, robust=False)


@pytest.mark.long
@pytest.mark.parametrize("see", SEEN)
def test_deviations_are_neither_small_nor_large(see: str) -> None:
    """Errors whitened by the covariance the fit states have a spread of 1, and so has the noise over its estimate."""
    scores, noise = [], []
    for seed in range(60):
        truth, fit = fitted(see, seed)
        assert fit.status == "converged"
        whiten = np.linalg.inv(np.linalg.cholesky(fit.correlation))
        scores.append(whiten @ ((fit.theta - truth.theta) / fit.stderr))
        noise.append(fit.sigma / NOISE)
    assert np.std(scores) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(scores)) < 0.2
    if see != "pose":
        assert np.mean(noise) == pytest.approx(1.0, abs=0.025)


@pytest.mark.long
def test_correlation_is_that_of_repeated_fits() -> None:
    fits = [fitted("position", seed, count=30) for seed in range(40)]
    misses = np.array([fit.theta - truth.theta for truth, fit in fits])
    expected = np.mean([fit.correlation for _, fit in fits], axis=0)
    strong = np.abs(expected) > 0.3
    np.testing.assert_allclose(np.corrcoef(misses.T)[strong], expected[strong], atol=0.4)
    assert np.allclose(np.diag(expected), 1.0)


@pytest.mark.parametrize("name", ["irb6400r", "ur5", "dh"])
def test_the_complete_set_predicts_unseen_poses_to_the_noise(name: str) -> None:
    truth = measure(name, (), (), 11, count=110)
    fit = calibrate(ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism)), truth.poses)
    fresh = prepare(truth.model.mechanism, bare(name, 60, 99, payload=False))
    clean = prepare(truth.model.mechanism, replace(fresh.dataset, position=true_tips(truth, fresh)))
    assert np.sqrt(np.mean(errors_on(fit, clean) ** 2)) < np.sqrt(3) * NOISE
    assert fit.sigma == pytest.approx(NOISE, rel=0.2)


def test_exact_data_are_fitted_exactly() -> None:
    truth = measure("irb6400r", few("irb6400r"), 1e-3 * np.arange(1, 6), 2, count=60, noise=0.0, geometry=0.0)
    fit = calibrate(truth.model, truth.poses)
    np.testing.assert_allclose(fit.theta, truth.theta, rtol=1e-6)
    for label, frame in truth.placement.registration.items():
        np.testing.assert_allclose(fit.placement.registration[label], frame, atol=1e-7)
    np.testing.assert_allclose(fit.placement.tool[""], truth.placement.tool[""], atol=1e-7)
    assert fit.error.max() < 1e-8


@pytest.mark.parametrize("see", ["position", "pose"])
def test_several_setups_and_tools_are_identified_together(see: str) -> None:
    theta = 1e-3 * np.array([1.0, -1.0, 0.5, 0.5, 0.3])
    truth = measure("irb6400r", few("irb6400r"), theta, 3, geometry=0.0, setups=3, tools=2, see=SEEN[see])
    fit = calibrate(truth.model, truth.poses)
    assert (np.abs(fit.theta - theta) < 4 * fit.stderr).all()
    for label, frame in truth.placement.registration.items():
        np.testing.assert_allclose(fit.placement.registration[label], frame, atol=3e-4)
    for label, frame in truth.placement.tool.items():
        np.testing.assert_allclose(fit.placement.tool[label][:3, 3], frame[:3, 3], atol=1e-4)
    alone = calibrate(truth.model, truth.poses.subset(np.flatnonzero(truth.poses.dataset.label("setup") == "s0")))
    assert (fit.stderr < alone.stderr).all()


@pytest.mark.parametrize("see", [("position",), ("position", "rotation", "distance")])
def test_placement_columns_are_the_derivatives_of_its_steps(see: tuple[str, ...]) -> None:
    truth = measure("ur5", (), (), 5, count=12, noise=0.0, setups=2, tools=2, see=see)
    use = np.ones(12, dtype=bool)
    problem = linearise(truth.model, truth.poses, truth.theta, truth.placement, Weighting({}, use))
    for k in range(problem.placement):
        step = np.zeros(problem.placement)
        moved = []
        for side in (1, -1):
            step[k] = side * 1e-6
            there = placement_after(problem.observed, truth.placement, step)
            moved.append(np.nan_to_num(residuals(truth, there, truth.theta, truth.model)))
        numeric = (moved[1] - moved[0])[problem.weights > 0] / 2e-6
        np.testing.assert_allclose(problem.columns[:, k], numeric, atol=1e-6, err_msg=problem.placement_names[k])


def test_what_is_returned_is_what_was_optimised() -> None:
    truth = measure("irb6400r", (), (), 6)
    fit = calibrate(ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism)), truth.poses)
    seen = observe(fit.model, truth.poses, fit.theta, fit.placement)
    np.testing.assert_array_equal(fit.error, pose_error(seen, truth.poses.dataset, {}))
    np.testing.assert_array_equal(errors_on(fit, truth.poses), fit.error)
    assert (fit.theta[~fit.free] == 0.0).all()
    rng = np.random.default_rng(0)
    for _ in range(5):
        step = 3 * np.nan_to_num(fit.stderr) * rng.normal(size=len(fit.theta))
        worse = observe(fit.model, truth.poses, fit.theta + step, fit.placement)
        assert np.sum(pose_error(worse, truth.poses.dataset, {}) ** 2) > np.sum(fit.error**2)


def test_outliers_are_listed_by_row_and_do_not_move_the_fit() -> None:
    truth = measure("irb6400r", few("irb6400r"), 1e-3 * np.ones(5), 8, count=60, geometry=0.0)
    bumped = truth.poses.dataset.position.copy()
    bumped[[13, 41]] += [[2e-3, 0, 0], [0, -1e-3, 1e-3]]
    poses = prepare(truth.model.mechanism, replace(truth.poses.dataset, position=bumped))
    fit, clean = calibrate(truth.model, poses), calibrate(truth.model, truth.poses)
    assert sorted(fit.outliers) == [13, 41]
    assert len(clean.outliers) == 0
    assert (np.abs(fit.theta - clean.theta) < 0.5 * clean.stderr).all()
    assert fit.error[[13, 41]].min() > 1e-3
    spoilt = calibrate(truth.model, poses, robust=False)
    assert len(spoilt.outliers) == 0
    assert spoilt.sigma > 3 * fit.sigma


def test_dropped_parameters_are_named_and_carry_no_deviation() -> None:
    truth = measure("irb6400r", (), (), 9)
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    fit = calibrate(model, truth.poses)
    assert set(fit.dropped) == {e.name for e, k in zip(model.effects, fit.free, strict=True) if not k}
    assert 5 < len(fit.dropped) < 20
    assert np.isnan(fit.stderr[~fit.free]).all()
    assert np.isfinite(fit.stderr[fit.free]).all()
    assert (fit.unique_share[fit.free] > 0).all()
    assert fit.rank == 9 + fit.free.sum()


def test_the_condition_limit_is_a_visible_choice() -> None:
    truth = measure("irb6400r", (), (), 9)
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    fits = [calibrate(model, truth.poses, condition_limit=limit) for limit in (3.0, 50.0, 1e5)]
    assert [f.condition_limit for f in fits] == [3.0, 50.0, 1e5]
    assert fits[0].rank < fits[1].rank <= fits[2].rank
    chosen = calibrate(model, truth.poses)
    best = min(chosen.rank_curve, key=lambda c: c.cv_rms)
    good = [c for c in chosen.rank_curve if c.cv_rms <= best.cv_rms + best.spread]
    assert chosen.condition_limit == max(good, key=lambda c: c.rank).condition_limit
    assert chosen.rank_curve[0].rank == 9
    assert chosen.rank_curve[0].cv_rms > 10 * best.cv_rms


def test_a_parameter_nothing_shows_is_dropped_before_its_column_is_scaled() -> None:
    """Errors of the frame in which rotations are seen, about an axis through the measured point, move nothing."""
    truth = measure("ur5", (), (), 9, count=40, geometry=0.0)
    spin = effect_at("spin", "tool", "Rx")
    tiny = effect_at("tiny", "base", "Tx", Expression("1e-13*sin(elbow_joint)"))
    data = truth.poses.dataset
    placed = replace(truth.placement, tool={"": np.eye(4)})
    seen = observe(truth.model, truth.poses, truth.theta, placed).tip[:, :3, 3]
    poses = prepare(truth.model.mechanism, replace(data, position=seen + NOISE * np.sin(np.arange(120).reshape(40, 3))))
    fit = calibrate(ErrorModel(truth.model.mechanism, (spin, tiny)), poses)
    assert fit.dropped == ("spin", "tiny")
    assert fit.status == "converged"


def test_partners_name_what_cannot_be_told_apart_and_shares_say_how_little_is_left() -> None:
    name = "irb6400r"
    joint = mechanism(name).joints[1]
    pair = (drive_effect("a", joint, Expression("sin(J2)")), drive_effect("b", joint, Expression("J2 - 0.1*J2**3")))
    truth = measure(name, pair, (1e-3, 0.0), 10, geometry=0.0)
    fit = calibrate(truth.model, truth.poses)
    assert fit.unique_share.max() < 0.5
    assert dict(fit.partners["a"])["b"] == pytest.approx(fit.correlation[0, 1])
    assert abs(fit.correlation[0, 1]) > 0.8


def test_a_second_fit_from_the_first_agrees_and_changes_nothing_in_place() -> None:
    truth = measure("irb6400r", (), (), 12)
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    first = calibrate(model, truth.poses)
    kept = first.theta.copy(), {k: v.copy() for k, v in first.placement.registration.items()}
    second = calibrate(model, truth.poses, start=first, condition_limit=first.condition_limit)
    np.testing.assert_allclose(second.error, first.error, atol=1e-9)
    np.testing.assert_array_equal(first.theta, kept[0])
    np.testing.assert_array_equal(first.placement.registration[""], kept[1][""])
    assert geometric_effects(truth.model.mechanism) == model.effects


def test_the_sign_and_side_of_an_offset_are_those_of_the_joint() -> None:
    """A controller that adds 2 mrad to what it reports of J3 has a zero error of -2 mrad."""
    truth = measure("ur5", (), (), 13, count=40, geometry=0.0)
    q = truth.poses.dataset.q.copy()
    q[:, 2] += 2e-3
    poses = prepare(truth.model.mechanism, replace(truth.poses.dataset, q=q))
    fit = calibrate(ErrorModel(truth.model.mechanism, few("ur5")[:1]), poses)
    assert fit.theta[0] == pytest.approx(-2e-3, abs=4 * fit.stderr[0])


def test_fewer_measurements_than_unknowns_are_refused() -> None:
    truth = measure("ur5", (), (), 14, count=4)
    with pytest.raises(InputError, match=r"12 measured values for .* unknowns; expected more poses"):
        calibrate(ErrorModel(truth.model.mechanism, few("ur5")), truth.poses)


def test_wrong_joint_values_are_a_status_with_a_reason_or_a_large_sigma_and_never_a_crash() -> None:
    truth = measure("ur5", (), (), 15, count=40)
    poses = prepare(truth.model.mechanism, replace(truth.poses.dataset, q=np.degrees(truth.poses.dataset.q)))
    fit = calibrate(ErrorModel(truth.model.mechanism, few("ur5")), poses)
    assert fit.status in ("converged", "stalled", "diverged")
    assert fit.reason
    assert fit.sigma > 0.05


def test_an_instrument_that_sees_no_absolute_point_identifies_the_tool_and_its_anchors() -> None:
    truth, fit = fitted("distance", 4, count=80)
    for anchor, point in truth.placement.anchors.items():
        np.testing.assert_allclose(fit.placement.anchors[anchor], point, atol=2e-3)
    np.testing.assert_allclose(fit.placement.tool[""][:3, 3], truth.placement.tool[""][:3, 3], atol=1e-3)


def test_empty_cells_cost_only_their_own_component() -> None:
    truth = measure("ur5", few("ur5"), 1e-3 * np.ones(5), 16, count=60, geometry=0.0)
    holes = truth.poses.dataset.position.copy()
    holes[5:15, 2] = np.nan
    fit = calibrate(truth.model, prepare(truth.model.mechanism, replace(truth.poses.dataset, position=holes)))
    assert (np.abs(fit.theta - truth.theta) < 4 * fit.stderr).all()
    assert np.isfinite(fit.error).all()


@pytest.mark.parametrize("harmonics", [3, 30])
def test_a_fit_ends_where_a_step_on_columns_of_that_very_point_moves_nothing(harmonics: int) -> None:
    """Columns stay as they are over the last steps, and so many effects are solved by normal equations."""
    curves = tuple(
        drive_effect(f"{f} {k} {j.name}", j, Expression(f"{f}({k}*{j.name})"), prior=1e-4 / k)
        for j in mechanism("ur5").joints[1:3]
        for k in range(1, harmonics + 1)
        for f in ("sin", "cos")
    )
    truth = measure("ur5", curves[:6], 1e-4 * np.ones(6), 4, count=60)
    model = ErrorModel(truth.model.mechanism, (*truth.model.effects, *curves[6:]))
    fit = calibrate(model, truth.poses, robust=False)
    problem = linearise(model, truth.poses, fit.theta, fit.placement, Weighting(fit.weights, np.ones(60, dtype=bool)))
    free = np.concatenate([np.ones(problem.placement, dtype=bool), fit.free])
    known = fit_priors(model, problem, fit.theta, fit.placement, fit.free)
    system = np.vstack([problem.columns, known.rows])[:, free]
    target = np.concatenate([problem.residual, known.rhs])
    scale = np.linalg.norm(system, axis=0)
    step = np.linalg.lstsq(system / scale, target, rcond=1e-12)[0] / scale
    assert fit.status == "converged"
    assert np.abs(problem.columns[:, free] @ step).max() < 2 * STEP_TOLERANCE


def close_to_the_axis(noise: float) -> tuple[ErrorModel, Poses, Placement]:
    """A robot whose tool point is close to the axis of its flange: a twist before it, the offset of the wrist and the
    length of the tool nearly stand for each other."""
    arm, rng = mechanism("ur10"), np.random.default_rng(0)
    model, data = ErrorModel(arm, geometric_effects(arm)), bare("ur10", 60)
    tool = np.eye(4)
    tool[:3, 3] = 1e-4, 3e-4, 0.068
    placement = Placement({"": np.eye(4)}, {"": tool}, {})
    truth = 3e-4 * rng.normal(size=len(model.effects))
    tips = observe(model, prepare(arm, data), truth, placement).tip[:, :3, 3]
    return model, prepare(arm, replace(data, position=tips + rng.normal(0.0, noise, tips.shape))), placement


@pytest.mark.parametrize("twist", [-0.27, 0.1, 0.4])
def test_a_fit_follows_a_valley_that_bends(twist: float) -> None:
    """From the best fit with a wrong twist the way is long, flat and curved."""
    model, poses, placement = close_to_the_axis(NOISE)
    names = [e.name for e in model.effects]
    kept = calibrate(model, poses, robust=False, condition_limit=100.0).free
    kept[[names.index(f"wrist_{name}") for name in ("1_joint Tz", "2_joint Tx", "2_joint Rx")]] = True
    fitting = Fitting(model, poses, np.ones(len(poses), dtype=bool), {}, sharing(poses.dataset))
    start = np.where(np.array(names) == "wrist_2_joint Rx", twist, 0.0)
    astray = iterate(fitting, start, placement, kept & (start == 0.0))
    found = iterate(fitting, astray.theta, astray.placement, kept)
    assert found.status == "converged"
    assert np.sqrt(np.mean(found.problem.residual**2)) < NOISE
    assert abs(found.theta[names.index("wrist_2_joint Rx")]) < 0.01


def test_what_the_poses_hardly_show_stays_near_the_description() -> None:
    """By poses measured to a millimetre the twist is known to half a radian, by its description to ten milliradians."""
    model, poses, placement = close_to_the_axis(1e-3)
    fit = calibrate(model, poses, robust=False, condition_limit=1e4)
    at = [e.name for e in model.effects].index("wrist_2_joint Rx")
    assert fit.free[at]
    assert abs(fit.theta[at]) < 3 * GEOMETRY_REACH
    assert fit.stderr[at] < 1.2 * GEOMETRY_REACH
    assert np.linalg.norm(fit.placement.tool[""][:3, 3] - placement.tool[""][:3, 3]) < 0.01


@pytest.mark.parametrize(("prior", "counted"), [(1e-9, 0), (1e-1, 1)])
def test_an_unknown_that_its_prior_holds_does_not_count(prior: float, counted: int) -> None:
    made = gp.simulate("irb6400r", ["J2.moving:Rz:sin(J2)=2e-4"], poses=40, geometry_sigma="0 mm")
    arm = made.truth.mechanism
    wave = effect_at("wave", "J2.moving", "Rz", Expression("sin(J2)"), prior=prior)
    fit = calibrate(ErrorModel(arm, (wave,)), prepare(arm, made.table))
    assert fit.effective == fit.rank - 1 + counted


def test_a_fit_weighs_orientations_by_its_own_residual_and_not_by_that_of_its_start() -> None:
    """An effect that the start lacks changes the residuals of positions and of orientations by different factors."""
    truth = measure("ur5", few("ur5"), np.array([0.0, 0.0, 2e-3, 2e-3, 0.0]), 3, see=SEEN["pose"])
    arm = truth.model.mechanism
    standard = geometric_effects(arm)
    whole = ErrorModel(arm, (*standard, *few("ur5")[2:4]))
    before = calibrate(ErrorModel(arm, standard), truth.poses)
    alone, after = calibrate(whole, truth.poses), calibrate(whole, truth.poses, start=before)
    assert abs(np.log(before.weights["rotation"] / alone.weights["rotation"])) > 0.2
    assert after.weights == pytest.approx(alone.weights, rel=0.1)
    assert after.sigma == pytest.approx(alone.sigma, rel=0.1)


@pytest.mark.parametrize(("prior", "counted"), [(1e-9, 0), (1e3, 5)])
def test_an_unknown_that_its_prior_determines_takes_no_degree_of_freedom(prior: float, counted: int) -> None:
    effects = tuple(replace(effect, prior=prior) for effect in few("ur5"))
    truth = measure("ur5", effects, np.zeros(5), 3, count=20, geometry=0.0)
    fit = calibrate(ErrorModel(truth.model.mechanism, effects), truth.poses, robust=False)
    assert fit.freedom == pytest.approx(60 - 9 - counted, abs=0.1)
