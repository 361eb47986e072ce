"""Test that a fit to two narrowly moving joints is never worse than its start."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effect_cases import MECHANISMS, NOISE, Truth, bare, measure, mechanism, true_tips

import gpmodel as gp
from gpmodel.calibration import iterate
from gpmodel.calibration.comparison import fit_steps, nested_models
from gpmodel.calibration.gauge import at_fixed_joints, still_joints
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import Calibration, errors_on, without_outlier_marks
from gpmodel.calibration.start import start_placements
from gpmodel.calibration.tool_point import hang_payload
from gpmodel.errors import InputError
from gpmodel.formula.expression import Expression
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice
from gpmodel.model.effect import drive_effect
from gpmodel.model.error_model import ErrorModel, observe, prepare
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
    held = {e.name.split()[0] for e, k in zip(fit.model.effects, fit.free, strict=True) if k}
    assert held
    assert held <= {"J2", "J5"}


def test_every_step_of_the_ladder_fits_at_least_as_well_as_the_one_before() -> None:
    truth = robot("ur5", (1, 2, 3), 0.3, 1)
    arm = truth.model.mechanism
    wrong = [(f"tanh {j.name}", (drive_effect("t", j, Expression(f"tanh(9*{j.name})")),)) for j in arm.joints[:2]]
    rungs = fit_steps(
        arm, nested_models(geometric_effects(arm), wrong),
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
    np.testing.assert_array_equal(fits[0].free, fits[1].free)
    held = [e.name for e, k in zip(model.effects, fits[0].free, strict=True) if k]
    zeros = {f"{j.name} {j.drive[0][1]}" for j in arm.joints[1:-1]}
    assert zeros <= set(held)
    assert len(held) == 18
    apart = (fits[0].theta - fits[1].theta)[fits[0].free]
    assert (np.abs(apart) < 4.5 * np.hypot(fits[0].stderr, fits[1].stderr)[fits[0].free]).all()


@pytest.mark.long
@pytest.mark.parametrize("see", [("position",), ("position", "rotation")])
def test_registration_and_tool_come_with_deviations_that_hold(see: tuple[str, ...]) -> None:
    scores = []
    for seed in range(25):
        truth = measure("ur5", (), (), seed, count=30, geometry=0.0, see=see)
        fit = calibrate(truth.model, truth.poses, robust=False)
        known = {p.name: p for p in fit.placement_numbers}
        assert [p.unit for p in fit.placement_numbers][:6] == ["m"] * 3 + ["rad"] * 3
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
        known = {p.name: p for p in fit.placement_numbers}
        scores += [(known[f"registration r{a}"].value - w) / known[f"registration r{a}"].stderr
                   for a, w in zip("yz", wanted[1:], strict=True)]  # fmt: skip
    assert np.std(scores) == pytest.approx(1.0, abs=0.25)


def test_no_effect_is_looked_for_at_a_joint_that_stands_still() -> None:
    truth = robot("irb6400r", (1, 4), 0.6, 0)
    arm, data = truth.model.mechanism, truth.poses.dataset
    still = still_joints(arm, data)
    assert still == ("J1", "J3", "J4", "J6")
    assert at_fixed_joints(("J3.moving",), still)
    assert not at_fixed_joints(("J2.moving", "J3.moving"), still)
    assert not at_fixed_joints(("base",), still)


def test_one_pose_measured_metres_away_is_left_out_and_changes_nothing_else() -> None:
    truth = measure("irb6400r", (), (), 1, count=60)
    model = ErrorModel(truth.model.mechanism, geometric_effects(truth.model.mechanism))
    position = truth.poses.dataset.position.copy()
    position[1] += [1.5, -2.5, 0.5]
    far = calibrate(model, prepare(truth.model.mechanism, replace(truth.poses.dataset, position=position)))
    rest = calibrate(model, truth.poses.subset(np.delete(np.arange(60), 1)))
    assert far.outliers.tolist() == [1]
    assert far.status == "converged"
    assert far.free.tolist() == rest.free.tolist()
    np.testing.assert_allclose(far.theta, rest.theta, atol=1e-9)


ARM = MechanismChoice("irb6400r").load()


def test_the_payload_hangs_where_registration_and_tool_alone_put_the_point() -> None:
    truth = measure("irb6400r", (), (), 1, geometry=0.0, dataset=bare("irb6400r", 60, 1))
    arm, poses = hang_payload(ARM, truth.poses)
    assert isinstance(arm, LoadedMechanism)
    assert arm.choice.payload_com == pytest.approx(truth.placement.tool[""][:3, 3], abs=1e-4)
    there = ARM.loads(truth.poses.dataset.q, truth.poses.dataset.payload)["torque_J5"]
    assert np.abs(poses.states["torque_J5"] - there).max() > 1.0
    again = arm.choice.load().loads(poses.dataset.q, poses.dataset.payload)["torque_J5"]
    np.testing.assert_allclose(poses.states["torque_J5"], again)
    assert ARM.choice.payload_com is None


@pytest.mark.first(1)
@pytest.mark.parametrize("masses", [(0.0, 20.0), (3.0, 21.0), (20.0, 20.0)])
def test_each_of_several_tools_has_its_own_centre(masses: tuple[float, float], tmp_path: Path) -> None:
    truth = measure("irb6400r", (), (), 1, geometry=0.0, dataset=bare("irb6400r", 60, 1))
    second, data = np.arange(60) % 2 == 1, truth.poses.dataset
    points = [truth.placement.tool[""][:3, 3] + shift for shift in (np.zeros(3), np.array([0.2, -0.1, 0.1]))]
    tips = [
        observe(truth.model, truth.poses, truth.theta, replace(truth.placement, tool={"": se3.shift(point)})).tip
        for point in points
    ]
    position = np.where(second[:, None], *(tip[:, :3, 3] for tip in reversed(tips)))
    labels = {**data.labels, "tool": np.where(second, "B", "A")}
    table = replace(data, position=position, labels=labels, payload=np.array(masses)[second.astype(int)])
    arm, poses = hang_payload(ARM, prepare(ARM, table))
    assert isinstance(arm, LoadedMechanism)
    saved = gp.calibrate(arm, table, ["joint_compliance J5"], holdout=0.0).model
    saved.save(tmp_path / "model.json")
    again = gp.load_model(tmp_path / "model.json").mechanism
    for states in (poses.states, prepare(again, table).states, prepare(arm, table.subset(np.arange(60))).states):
        for label, point in zip("AB", points, strict=True):
            rows = table.label("tool") == label
            alone = ARM.carrying_at(point).loads(table.q[rows], table.payload[rows])
            for load, values in alone.items():
                np.testing.assert_allclose(states[load][rows], values, atol=0.05)
    assert ARM.choice.tool_coms == ()


@pytest.mark.parametrize("kind", ["nothing carried", "centre given", "built in Python"])
def test_nothing_changes_where_nothing_is_carried_or_its_centre_is_known(kind: str) -> None:
    poses = measure("irb6400r", (), (), 1, geometry=0.0, dataset=bare("irb6400r", 60, 1)).poses
    arm = {"centre given": ARM.carrying_at((0.0, 0.0, 0.1)), "built in Python": ARM.bare}.get(kind, ARM)
    if kind == "nothing carried":
        poses = prepare(ARM, replace(poses.dataset, payload=np.zeros(60)))
    same, untouched = hang_payload(arm, poses)
    assert same is arm
    assert untouched is poses


POSES, TIMES = 24, 3
SHARED, ALONE = 4e-5, 1e-5


def repeated(seed: int, times: int = TIMES) -> Truth:
    """Poses measured several times, which share a deviation four times as large as that of a measurement."""
    single = bare("ur5", POSES, seed, payload=False)
    data = single.subset(np.tile(np.arange(POSES), times))
    data = replace(data, row=np.arange(1, len(data) + 1))
    joints = mechanism("ur5").joints
    effects = [
        drive_effect(f"{f} {j.name}", j, Expression(f"{f}({j.name})")) for j in joints[2:4] for f in ("sin", "cos")
    ]
    truth = measure("ur5", effects, [1e-3, -5e-4, 2e-4, 1e-4], seed, dataset=data, geometry=0.0, noise=ALONE)
    shared = SHARED * np.random.default_rng([seed, 9]).normal(size=(POSES, 3))
    moved = replace(truth.poses.dataset, position=truth.poses.dataset.position + np.tile(shared, (times, 1)))
    return replace(truth, poses=replace(truth.poses, dataset=moved))


def fitted(truth: Truth) -> Calibration:
    return calibrate(truth.model, truth.poses, robust=False)


@pytest.mark.long
def test_deviations_are_right_where_poses_are_repeated() -> None:
    truths = [repeated(seed) for seed in range(40)]
    scores = [(fit.theta - truth.theta) / fit.stderr for truth, fit in ((t, fitted(t)) for t in truths)]
    assert np.std(scores) == pytest.approx(1.0, abs=0.15)


def test_as_many_repeats_of_every_pose_are_their_mean() -> None:
    """The numbers, and up to the freedom left for the noise their deviations, are those of one mean a pose."""
    truth = repeated(3)
    data = truth.poses.dataset
    mean = replace(data.subset(np.arange(POSES)), position=data.position.reshape(TIMES, POSES, 3).mean(axis=0))
    of_means = calibrate(truth.model, prepare(truth.model.mechanism, mean), robust=False)
    fit = fitted(truth)
    np.testing.assert_allclose(fit.theta, of_means.theta, atol=1e-9)
    np.testing.assert_allclose(fit.stderr, of_means.stderr, rtol=0.15)
    assert of_means.freedom == 3 * POSES - of_means.rank
    assert of_means.freedom < fit.freedom < 1.5 * of_means.freedom


def test_measuring_again_adds_little_where_poses_share_most() -> None:
    """Twelve repeats of a pose are worth hardly more than three."""
    few, many = (fitted(repeated(5, times)) for times in (3, 12))
    assert np.all(many.stderr > 0.8 * few.stderr)
    assert few.pose_ratio == pytest.approx((SHARED / ALONE) ** 2, rel=0.6)


def test_poses_measured_once_have_one_level_of_noise() -> None:
    assert fitted(repeated(1, times=1)).pose_ratio == 0.0


SEEN = {
    "position": ("position",),
    "pose": ("position", "rotation"),
    "distance": ("distance",),
    "all": ("position", "rotation", "distance"),
}


@pytest.mark.parametrize("name", ["irb6400r", "ur5", "dh"])
@pytest.mark.parametrize("see", ["position", "pose", "all"])
def test_an_innocent_robot_is_placed_exactly(name: str, see: str) -> None:
    truth = measure(name, (), (), 4, count=25, noise=0.0, geometry=0.0, see=SEEN[see])
    start = next(start_placements(truth.poses))
    seen = observe(truth.model, truth.poses, truth.theta, start)
    np.testing.assert_allclose(seen.tip[:, :3, 3], truth.poses.dataset.position, atol=1e-6)
    np.testing.assert_allclose(start.tool[""][:3, 3], truth.placement.tool[""][:3, 3], atol=1e-5)
    if see != "position":
        true = observe(truth.model, truth.poses, truth.theta, truth.placement).tip
        np.testing.assert_allclose(seen.tip[:, :3, :3], true[:, :3, :3], atol=1e-6)
    for anchor, point in start.anchors.items():
        np.testing.assert_allclose(point, truth.placement.anchors[anchor], atol=1e-4)


@pytest.mark.parametrize("see", ["position", "pose"])
def test_several_setups_and_tools_are_placed_together(see: str) -> None:
    truth = measure("irb6400r", (), (), 4, count=60, noise=0.0, geometry=0.0, setups=3, tools=2, see=SEEN[see])
    start = next(start_placements(truth.poses))
    assert list(start.registration) == ["s0", "s1", "s2"]
    assert list(start.tool) == ["t0", "t1"]
    for label, frame in truth.placement.registration.items():
        np.testing.assert_allclose(start.registration[label], frame, atol=1e-5)
    for label, frame in truth.placement.tool.items():
        np.testing.assert_allclose(start.tool[label], frame, atol=1e-5)


def test_a_joint_error_of_a_robot_leaves_a_start_of_its_size() -> None:
    truth = measure("irb6400r", (), (), 4, count=40, geometry=1e-3)
    seen = observe(truth.model, truth.poses, np.zeros_like(truth.theta), next(start_placements(truth.poses)))
    assert np.linalg.norm(seen.tip[:, :3, 3] - truth.poses.dataset.position, axis=1).max() < 0.02


@pytest.mark.parametrize("name", MECHANISMS)
def test_too_few_poses_name_the_setup(name: str) -> None:
    truth = measure(name, (), (), 4, count=5, setups=2)
    data = replace(truth.poses.dataset, labels={"setup": np.array(["s0", "s0", "s0", "s0", "later"])})
    with pytest.raises(InputError, match="setup 'later': 1 poses with x, y and z; registration needs at least 3"):
        next(start_placements(prepare(truth.model.mechanism, data)))


def test_too_few_distances_name_the_column() -> None:
    truth = measure("ur5", (), (), 4, count=20, see=("position", "distance"))
    few = {k: np.where(np.arange(20) < 3, v, np.nan) for k, v in truth.poses.dataset.distances.items()}
    with pytest.raises(InputError, match="column 'distance_0': 3 distances; anchor and zero need at least 5"):
        next(start_placements(prepare(truth.model.mechanism, replace(truth.poses.dataset, distances=few))))


@pytest.mark.long
@pytest.mark.parametrize("seed", [2, 7])
def test_balls_touched_by_an_unknown_tool_are_placed_from_whichever_tool_fits_best(seed: int) -> None:
    """From the flange alone both seeds end in another minimum, centimetres off."""
    made = gp.simulate("irb6400r", poses=40, instrument="spheres", geometry_sigma="1 mm", seed=seed)
    fit = gp.calibrate("irb6400r", made.table, holdout=0).fit[0]
    assert fit.status == "converged"
    assert fit.sigma < 2e-4
    off = fit.placement.tool[""][:3, 3] - made.truth.saved.placement.tool[""][:3, 3]
    assert np.linalg.norm(off) < 0.02


@pytest.mark.long
def test_few_touches_of_balls_hold_constants_enough() -> None:
    """Twenty-eight touches fitted for fifteen numbers of three balls and a tool: some constants are held, none too
    many."""
    made = gp.simulate("irb6400r", poses=40, instrument="spheres", geometry_sigma="1 mm", seed=3)
    result = gp.calibrate("irb6400r", made.table)
    assert [step.calibration.status for step in result.calibrated.steps] == ["converged"] * 2
    last = result.calibrated.steps[-1].calibration
    assert 10 <= sum(k and e.constant for k, e in zip(last.free, last.model.effects, strict=True)) < 13
    assert result.fit[0].sigma < 2e-4
