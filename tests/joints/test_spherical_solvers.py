"""Free angles: elimination, re-solved angles, variable projection and leap-frog."""

from dataclasses import replace

import numpy as np
import pytest
from spherical_cases import JOINT, OFFSETS, PUBLISHED, published_table

from experiments.spherical_joint.leapfrog import leap_frog
from experiments.spherical_joint.rig import Rig
from experiments.spherical_joint.sphere_fit import fit_sphere
from experiments.spherical_joint.varpro import variable_projection
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on, resolved
from gpmodel.calibration.unmeasured_joints import eliminate, joint_columns, solve_joints
from gpmodel.errors import InputError
from gpmodel.model.error_model import ErrorModel, Placement, observe, prepare
from joints.kinematics import THESIS_PARAMETERS, parameter

BARE = ErrorModel(JOINT, ())
WITH_OFFSETS = ErrorModel(JOINT, tuple(parameter(i).effect for i in OFFSETS))
FULL = ErrorModel(JOINT, tuple(p.effect for p in THESIS_PARAMETERS))
TRUTH = np.array(list(OFFSETS.values()))


def test_elimination_leaves_nothing_that_the_joints_could_explain() -> None:
    rng = np.random.default_rng(0)
    joints, columns = rng.standard_normal((20, 3, 2)), rng.standard_normal((20, 3, 4))
    pull = np.einsum("nmk,nk->nm", joints, rng.standard_normal((20, 2)))
    rows, residual, pose = eliminate(columns, pull, joints)
    assert rows.shape == (20, 4)
    np.testing.assert_allclose(residual, 0.0, atol=1e-14)
    np.testing.assert_array_equal(pose, np.arange(20))
    absorbed, _, _ = eliminate(np.concatenate([columns, joints[:, :, :1]], axis=2), pull, joints)
    assert not absorbed[:, 4].any()


def test_eliminating_equals_solving_with_a_column_for_every_angle_of_every_pose() -> None:
    rng = np.random.default_rng(1)
    count = 12
    joints, columns = rng.standard_normal((count, 3, 2)), rng.standard_normal((count, 3, 4))
    residual = rng.standard_normal((count, 3))
    residual[3, 1] = np.nan
    seen = np.isfinite(residual).ravel()
    own = np.zeros((3 * count, 2 * count))
    for i in range(count):
        own[3 * i : 3 * i + 3, 2 * i : 2 * i + 2] = joints[i]
    system = np.hstack([columns.reshape(3 * count, -1), own])[seen]
    together = np.linalg.lstsq(system, residual.ravel()[seen], rcond=None)[0][:4]
    rows, left, _ = eliminate(columns, residual, joints)
    np.testing.assert_allclose(np.linalg.lstsq(rows, left, rcond=None)[0], together, atol=1e-10)


def test_better_angles_come_out_than_went_in() -> None:
    rng = np.random.default_rng(2)
    q = PUBLISHED.poses(200, rng)
    data = PUBLISHED.measure(q, rng)
    tool = np.eye(4)
    truth = Placement({"": PUBLISHED.registration}, {"": tool}, {})
    poses = solve_joints(WITH_OFFSETS, prepare(JOINT, data), TRUTH, truth)
    before, after = (np.sqrt(np.mean((x - q) ** 2)) for x in (data.q, poses.dataset.q))
    assert after < 0.7 * before
    observed = observe(WITH_OFFSETS, poses, TRUTH, truth)
    error = data.position - observed.tip[:, :3, 3]
    tangential = np.einsum("nmk,nm->nk", joint_columns(JOINT, observed)[:, :3], error)
    assert np.abs(tangential).max() < 0.05 * 2e-6 * 0.045
    np.testing.assert_array_equal(data.position, poses.dataset.position)


def test_poses_without_a_measurement_keep_their_angles() -> None:
    _, data = published_table(0)
    position = data.position.copy()
    position[4] = np.nan
    poses = prepare(JOINT, replace(data, position=position))
    solved = solve_joints(BARE, poses, np.zeros(0), Placement({"": PUBLISHED.registration}, {"": np.eye(4)}, {}))
    np.testing.assert_array_equal(solved.dataset.q[4], data.q[4])
    assert np.all(solved.dataset.q[5] != data.q[5])


@pytest.mark.parametrize("seed", range(3))
def test_offsets_of_the_axes_are_recovered_and_the_rest_is_named_as_dropped(seed: int) -> None:
    _, data = published_table(seed)
    fit = calibrate(FULL, prepare(JOINT, data))
    kept = [p.index for p, k in zip(THESIS_PARAMETERS, fit.kept, strict=True) if k]
    assert kept == [14, 15, 19]
    assert fit.rank == 7
    np.testing.assert_array_less(np.abs(fit.theta[fit.kept] - TRUTH), 3 * fit.stderr[fit.kept])
    assert len(fit.dropped) == 27


@pytest.mark.long
def test_the_stated_deviation_of_the_pitch_offset_is_its_scatter() -> None:
    fits = [variable_projection(WITH_OFFSETS, prepare(JOINT, published_table(s)[1])) for s in range(40)]
    scatter = np.std([f.theta[1] for f in fits])
    stated = np.mean([calibrate(WITH_OFFSETS, prepare(JOINT, published_table(s)[1])).stderr[1] for s in range(8)])
    assert np.mean([f.theta[1] for f in fits]) == pytest.approx(-25.4e-6, abs=3 * scatter / np.sqrt(40))
    assert stated == pytest.approx(scatter, rel=0.3)


def test_calibrated_rig_predicts_new_poses_at_the_noise() -> None:
    rng = np.random.default_rng(5)
    poses = prepare(JOINT, PUBLISHED.measure(PUBLISHED.poses(60, rng), rng))
    fresh = prepare(JOINT, PUBLISHED.measure(PUBLISHED.poses(400, rng), rng))
    rms = [np.sqrt(np.mean(errors_on(calibrate(m, poses), fresh) ** 2)) for m in (BARE, WITH_OFFSETS)]
    assert rms[1] < 1.15 * PUBLISHED.noise < rms[0]
    fit = calibrate(WITH_OFFSETS, poses)
    assert np.abs(resolved(fit, fresh).dataset.q - fresh.dataset.q).max() < 6 * PUBLISHED.angle_noise


@pytest.mark.parametrize("model", [BARE, WITH_OFFSETS], ids=["base and tooling ball", "offsets"])
def test_variable_projection_converges_in_under_twenty_iterations(model: ErrorModel) -> None:
    _, data = published_table(1)
    solution = variable_projection(model, prepare(JOINT, data))
    assert solution.status == "converged"
    assert solution.iterations < 20


@pytest.mark.parametrize("model", [BARE, WITH_OFFSETS], ids=["base and tooling ball", "offsets"])
def test_a_calibration_is_variable_projection_from_its_own_orientation(model: ErrorModel) -> None:
    """The approximate angles alone tell how the base is turned, and that turns the offsets in second order."""
    _, data = published_table(1)
    fit = calibrate(model, prepare(JOINT, data), robust=False)
    solution = variable_projection(model, prepare(JOINT, data), start=fit.placement)
    np.testing.assert_allclose(solution.theta, fit.theta, atol=1e-9)
    np.testing.assert_allclose(solution.error, fit.error, atol=1e-9)


@pytest.mark.long
def test_leap_frog_meets_variable_projection_and_the_sphere_after_many_more_alternations() -> None:
    _, data = published_table(0)
    poses = prepare(JOINT, data)
    leap, projection = leap_frog(JOINT, BARE, poses), variable_projection(BARE, poses)
    assert leap.status == projection.status == "converged"
    np.testing.assert_allclose(leap.placement.registration[""][:3, 3], fit_sphere(data.position).centre, atol=1e-8)
    np.testing.assert_allclose(leap.error, projection.error, atol=1e-8)
    assert leap.iterations > 10 * projection.iterations
    assert leap.history[-1].rms < 0.02 * leap.history[0].rms


def test_a_solver_that_is_stopped_early_says_how_fast_it_was() -> None:
    _, data = published_table(0)
    solution = leap_frog(JOINT, BARE, prepare(JOINT, data), limit=5)
    assert (solution.status, solution.iterations) == ("stalled", 5)
    assert "after 5 iterations" in solution.reason


@pytest.mark.slow
def test_leap_frog_finds_the_same_offsets() -> None:
    _, data = published_table(2)
    poses = prepare(JOINT, data)
    leap, projection = leap_frog(JOINT, WITH_OFFSETS, poses), variable_projection(WITH_OFFSETS, poses)
    np.testing.assert_allclose(leap.theta, projection.theta, atol=0.3e-6)


def test_known_angles_show_what_free_ones_hide() -> None:
    rng = np.random.default_rng(7)
    known = JOINT.with_angles(measured=True)
    rig = Rig(known, parameters={12: 3e-4, 15: -25.4e-6}, angle_noise=0.0)
    data = rig.measure(rig.poses(60, rng), rng)
    effects = tuple(parameter(i).effect for i in (12, 15))
    fit = calibrate(ErrorModel(known, effects), prepare(known, data), condition_limit=50)
    np.testing.assert_array_less(np.abs(fit.theta - [3e-4, -25.4e-6]), 4 * fit.stderr)
    free = calibrate(ErrorModel(JOINT, effects), prepare(JOINT, data))
    np.testing.assert_array_equal(free.kept, [False, True])


@pytest.mark.parametrize(
    ("rows", "said"),
    [([0, 1, 2], "3 measured poses"), ([5] * 12, "one pose repeated 12 times")],
    ids=["too few", "repeated"],
)
def test_poses_that_determine_nothing_are_refused(rows: list[int], said: str) -> None:
    _, data = published_table(0)
    poses = prepare(JOINT, data.subset(rows))
    for solve in (
        lambda: calibrate(BARE, poses),
        lambda: variable_projection(BARE, poses),
        lambda: leap_frog(JOINT, BARE, poses),
    ):
        with pytest.raises(InputError, match=said):
            solve()


def test_points_in_one_plane_are_refused() -> None:
    rig = replace(PUBLISHED, angle_noise=0.0, noise=0.0, parameters={}, reach=(0.0, 0.0, 1.0))
    data = rig.measure(rig.poses(20, np.random.default_rng(0)), np.random.default_rng(1))
    with pytest.raises(InputError, match="one plane"):
        calibrate(BARE, prepare(JOINT, data))
