"""Tables that say little of a machine: two joints move, narrowly; a fit is never worse than its start, nor wild."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from effect_cases import NOISE, Truth, bare, measure, mechanism, true_tips

from gpmodel.calibration import iterate
from gpmodel.calibration.comparison import climb, growing
from gpmodel.calibration.gauge import stands_still, still_joints
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on, without_outlier_marks
from gpmodel.formula.expression import Expression
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.sites import geometric_effects
from gpmodel.numerics import se3
from gpmodel.table.dataset import Dataset

ARMS = ("irb6400r", "ur5")
MOVING = [((1, 2), 0.5), ((1, 2), 0.05), ((2, 3), 0.2), ((0, 1), 0.02), ((2,), 0.3)]


def moved(name: str, moving: tuple[int, ...], span: float, seed: int, count: int = 40) -> Dataset:
    """Poses at which only some joints move, by `span` rad to each side."""
    data = bare(name, count, seed, payload=False)
    middle = np.array([(max(j.lower, -2.0) + min(j.upper, 2.0)) / 2 + 0.3 for j in mechanism(name).joints])
    q = np.tile(middle, (count, 1))
    for j in moving:
        q[:, j] += span * np.random.default_rng([seed, j]).uniform(-1.0, 1.0, count)
    return replace(data, q=q)


def robot(name: str, moving: tuple[int, ...], span: float, seed: int) -> Truth:
    """With errors of 1 mm and 1 mrad, and a cyclic error that no model here knows."""
    joint = mechanism(name).joints[moving[-1]]
    unknown = (drive_effect("unknown", joint, Expression(f"sin(3*{joint.name})")),)
    return measure(name, unknown, (1e-4,), seed, dataset=moved(name, moving, span, seed), geometry=1e-3)


def rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))


@pytest.mark.long
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize(("moving", "span"), MOVING)
def test_the_standard_model_of_a_few_joints_is_no_worse_than_registration(
    name: str, moving: tuple[int, ...], span: float
) -> None:
    for seed in range(4):
        truth = robot(name, moving, span, seed)
        arm = truth.model.mechanism
        fresh = prepare(arm, moved(name, moving, span, seed + 100, 60))
        clean = prepare(arm, replace(fresh.dataset, position=true_tips(truth, fresh)))
        bare_fit = calibrate(ErrorModel(arm, ()), truth.poses)
        fit = calibrate(ErrorModel(arm, geometric_effects(arm)), truth.poses)
        assert rms(fit.error) <= 1.001 * rms(bare_fit.error)
        assert rms(errors_on(fit, clean)) <= rms(errors_on(bare_fit, clean)) + NOISE
        assert np.abs(fit.theta).max() < 0.2
        assert all(np.linalg.norm(frame[:3, 3]) < 2.0 for frame in fit.placement.tool.values())


def test_joints_that_stand_still_have_no_geometry() -> None:
    truth = robot("irb6400r", (1, 4), 0.6, 0)
    arm = truth.model.mechanism
    fit = calibrate(ErrorModel(arm, geometric_effects(arm)), truth.poses)
    held = {e.name.split()[0] for e, k in zip(fit.model.effects, fit.kept, strict=True) if k}
    assert held
    assert held <= {"J2", "J5"}


def test_every_step_of_the_ladder_fits_at_least_as_well_as_the_one_before() -> None:
    truth = robot("ur5", (1, 2, 3), 0.3, 1)
    arm = truth.model.mechanism
    wrong = [(f"tanh {j.name}", (drive_effect("t", j, Expression(f"tanh(9*{j.name})")),)) for j in arm.joints[:2]]
    rungs = climb(
        arm, growing(geometric_effects(arm), wrong),
        truth.poses.subset(np.arange(30)), truth.poses.subset(np.arange(30, 40)),
    )  # fmt: skip
    assert [r.name for r in rungs] == ["registration", "standard", *(name for name, _ in wrong)]
    for before, after in itertools.pairwise(rungs):
        assert rms(after.train_error) <= 1.001 * rms(before.train_error)


def test_a_fit_that_ends_above_its_start_keeps_the_start_and_says_so() -> None:
    """A limit that holds nothing throws away what the start knew."""
    truth = measure("irb6400r", (), (), 3, count=40)
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    good = calibrate(model, truth.poses)
    kept = calibrate(model, truth.poses, start=without_outlier_marks(good), condition_limit=1.0)
    assert kept.status == "kept previous"
    assert "mm a component after the fit" in kept.reason
    np.testing.assert_array_equal(kept.theta, good.theta)
    assert rms(kept.error) == pytest.approx(rms(good.error))


def test_of_limits_of_which_none_lets_a_fit_converge_the_one_that_leaves_least_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A lower limit is tried where the one that predicts best still moves, and throws away what the start knew."""
    curve = [Expression(f"tanh({k}*J2)*cos(J3)") for k in range(1, 4)]
    arm = mechanism("irb6400r")
    effects = [drive_effect(f"curve {k}", arm.joints[1], basis) for k, basis in enumerate(curve)]
    truth = measure("irb6400r", effects, [3e-3] * 3, 3, count=60)
    standard = calibrate(ErrorModel(arm, geometric_effects(arm)), truth.poses)
    monkeypatch.setattr(iterate, "MAX_ITERATIONS", 2)
    start = without_outlier_marks(standard)
    fit = calibrate(truth.model, truth.poses, start=start)
    limits = [choice.condition_limit for choice in fit.rank_curve]
    each = [calibrate(truth.model, truth.poses, start=start, condition_limit=limit) for limit in limits]
    assert not [other.status for other in each if other.status == "converged"]
    assert fit.sigma == pytest.approx(min(other.sigma for other in each), rel=0.1)
    assert fit.sigma < 0.5 * max(other.sigma for other in each)


@pytest.mark.parametrize("name", ARMS)
def test_two_tables_of_one_machine_hold_the_same_parameters(name: str) -> None:
    """Joint zeros first, then lengths, then twists; and the parameters agree within their deviations."""
    tables = (bare(name, 40, 5, payload=False), bare(name, 70, 6, payload=False))
    first, second = (measure(name, (), (), 5, dataset=table, geometry=1e-3) for table in tables)
    arm = first.model.mechanism
    model = ErrorModel(arm, geometric_effects(arm))
    fits = [calibrate(model, truth.poses) for truth in (first, second)]
    np.testing.assert_array_equal(fits[0].kept, fits[1].kept)
    held = [e.name for e, k in zip(model.effects, fits[0].kept, strict=True) if k]
    zeros = {f"{j.name} {j.drive[0][1]}" for j in arm.joints[1:-1]}
    assert zeros <= set(held)
    assert len(held) == 18
    apart = (fits[0].theta - fits[1].theta)[fits[0].kept]
    assert (np.abs(apart) < 4.5 * np.hypot(fits[0].stderr, fits[1].stderr)[fits[0].kept]).all()


@pytest.mark.long
@pytest.mark.parametrize("see", [("position",), ("position", "rotation")])
def test_registration_and_tool_come_with_deviations_that_hold(see: tuple[str, ...]) -> None:
    scores = []
    for seed in range(25):
        truth = measure("ur5", (), (), seed, count=30, geometry=0.0, see=see)
        fit = calibrate(truth.model, truth.poses, robust=False)
        known = {p.name: p for p in fit.placed}
        assert [p.unit for p in fit.placed][:6] == ["m"] * 3 + ["rad"] * 3
        for what, frame in (("registration", truth.placement.registration[""]), ("tool", truth.placement.tool[""])):
            for axis, value in zip("xyz", frame[:3, 3], strict=True):
                scores.append((known[f"{what} {axis}"].value - value) / known[f"{what} {axis}"].stderr)
    assert np.std(scores) == pytest.approx(1.0, abs=0.2)


@pytest.mark.long
def test_the_rotation_vector_of_a_large_turn_comes_with_deviations_that_hold() -> None:
    """Across its axis a rotation vector of 3 rad changes 1.5 times as much as the frame turns."""
    wanted, scores = np.array([3.0, 0.1, -0.1]), []
    for seed in range(25):
        truth = measure("ur5", (), (), seed, count=30, geometry=0.0)
        turn = se3.exp(np.concatenate([np.zeros(3), wanted]))[:3, :3] @ truth.placement.registration[""][:3, :3].T
        turned = replace(truth.poses.dataset, position=truth.poses.dataset.position @ turn.T)
        fit = calibrate(truth.model, replace(truth.poses, dataset=turned), robust=False)
        known = {p.name: p for p in fit.placed}
        scores += [(known[f"registration r{a}"].value - w) / known[f"registration r{a}"].stderr
                   for a, w in zip("yz", wanted[1:], strict=True)]  # fmt: skip
    assert np.std(scores) == pytest.approx(1.0, abs=0.25)


def test_no_effect_is_looked_for_at_a_joint_that_stands_still() -> None:
    truth = robot("irb6400r", (1, 4), 0.6, 0)
    arm, data = truth.model.mechanism, truth.poses.dataset
    still = still_joints(arm, data)
    assert still == ("J1", "J3", "J4", "J6")
    assert stands_still(("J3.moving",), still)
    assert not stands_still(("J2.moving", "J3.moving"), still)
    assert not stands_still(("base",), still)


def test_one_pose_measured_metres_away_is_left_out_and_changes_nothing_else() -> None:
    truth = measure("irb6400r", (), (), 1, count=60)
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    position = truth.poses.dataset.position.copy()
    position[1] += [1.5, -2.5, 0.5]
    far = calibrate(model, prepare(truth.model.mechanism, replace(truth.poses.dataset, position=position)))
    rest = calibrate(model, truth.poses.subset(np.delete(np.arange(60), 1)))
    assert far.outliers.tolist() == [1]
    assert far.status == "converged"
    assert far.kept.tolist() == rest.kept.tolist()
    np.testing.assert_allclose(far.theta, rest.theta, atol=1e-9)
