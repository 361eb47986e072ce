"""Test free angles: elimination, and angles solved again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from spherical_cases import JOINT, OFFSETS, PUBLISHED, published_table

import gpmodel as gp
from experiments.spherical_joint.reductions import algebraic_sphere, fit_sphere
from experiments.spherical_joint.rig import Rig
from gpmodel.application.over_causes import ball_priors
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.result import errors_on, resolved
from gpmodel.calibration.unmeasured_joints import eliminate, joint_columns, solve_joints
from gpmodel.errors import InputError
from gpmodel.model.error_model import ErrorModel, Placement, observe, prepare
from joints.passive_joint import THESIS_PARAMETERS, parameter

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
    kept = [p.index for p, k in zip(THESIS_PARAMETERS, fit.free, strict=True) if k]
    assert kept == [14, 15, 19]
    assert fit.rank == 7
    np.testing.assert_array_less(np.abs(fit.theta[fit.free] - TRUTH), 3 * fit.stderr[fit.free])
    assert len(fit.dropped) == 27


@pytest.mark.long
def test_the_stated_deviation_of_the_pitch_offset_is_its_scatter() -> None:
    fits = [calibrate(WITH_OFFSETS, prepare(JOINT, published_table(s)[1])) for s in range(40)]
    scatter = np.std([f.theta[1] for f in fits])
    assert np.mean([f.theta[1] for f in fits]) == pytest.approx(-25.4e-6, abs=3 * scatter / np.sqrt(40))
    assert np.mean([f.stderr[1] for f in fits]) == pytest.approx(scatter, rel=0.3)


@pytest.mark.long
def test_calibrated_rig_predicts_new_poses_at_the_noise() -> None:
    rng = np.random.default_rng(5)
    poses = prepare(JOINT, PUBLISHED.measure(PUBLISHED.poses(60, rng), rng))
    fresh = prepare(JOINT, PUBLISHED.measure(PUBLISHED.poses(400, rng), rng))
    rms = [np.sqrt(np.mean(errors_on(calibrate(m, poses), fresh) ** 2)) for m in (BARE, WITH_OFFSETS)]
    assert rms[1] < 1.15 * PUBLISHED.noise < rms[0]
    fit = calibrate(WITH_OFFSETS, poses)
    assert np.abs(resolved(fit, fresh).dataset.q - fresh.dataset.q).max() < 6 * PUBLISHED.angle_noise


def test_known_angles_show_what_free_ones_hide() -> None:
    rng = np.random.default_rng(7)
    known = JOINT.with_angles(measured=True)
    rig = Rig(known, parameters={12: 3e-4, 15: -25.4e-6}, angle_noise=0.0)
    data = rig.measure(rig.poses(60, rng), rng)
    effects = tuple(parameter(i).effect for i in (12, 15))
    fit = calibrate(ErrorModel(known, effects), prepare(known, data), condition_limit=50)
    np.testing.assert_array_less(np.abs(fit.theta - [3e-4, -25.4e-6]), 4 * fit.stderr)
    free = calibrate(ErrorModel(JOINT, effects), prepare(JOINT, data))
    np.testing.assert_array_equal(free.free, [False, True])


@pytest.mark.parametrize(
    ("rows", "said"),
    [([0, 1, 2], "3 measured poses"), ([5] * 12, "one pose repeated 12 times")],
    ids=["too few", "repeated"],
)
def test_poses_that_determine_nothing_are_refused(rows: list[int], said: str) -> None:
    _, data = published_table(0)
    poses = prepare(JOINT, data.subset(rows))
    with pytest.raises(InputError, match=said):
        calibrate(BARE, poses)


def test_points_in_one_plane_are_refused() -> None:
    rig = replace(PUBLISHED, angle_noise=0.0, noise=0.0, parameters={}, reach=(0.0, 0.0, 1.0))
    data = rig.measure(rig.poses(20, np.random.default_rng(0)), np.random.default_rng(1))
    with pytest.raises(InputError, match="one plane"):
        calibrate(BARE, prepare(JOINT, data))


CENTRE, RADIUS = np.array([0.12388, 0.02811, -0.20564]), 0.04521


def cap(rng: np.random.Generator, count: int, half_angle: float) -> np.ndarray:
    height = rng.uniform(np.cos(half_angle), 1.0, count)
    turn = rng.uniform(0.0, 2 * np.pi, count)
    across = np.sqrt(1 - height**2)
    return CENTRE + RADIUS * np.column_stack([across * np.cos(turn), across * np.sin(turn), height])


@pytest.mark.parametrize("half_angle", [0.2, 0.8, 1.6])
def test_exact_points_give_the_sphere_back(half_angle: float) -> None:
    points = cap(np.random.default_rng(0), 31, half_angle)
    centre, radius = algebraic_sphere(points)
    fit = fit_sphere(points)
    for found_centre, found_radius in ((centre, radius), (fit.centre, fit.radius)):
        np.testing.assert_allclose(found_centre, CENTRE, atol=1e-11)
        assert found_radius == pytest.approx(RADIUS, abs=1e-11)
    assert fit.status == "converged"


def test_the_stated_uncertainty_is_the_scatter_of_the_estimates() -> None:
    rng = np.random.default_rng(1)
    points = cap(rng, 31, 1.0)
    fits = [fit_sphere(points + 2e-6 * rng.standard_normal(points.shape)) for _ in range(300)]
    scatter = np.std([[*f.centre, f.radius] for f in fits], axis=0)
    stated = np.sqrt(np.mean([f.stderr**2 for f in fits], axis=0))
    np.testing.assert_allclose(stated / scatter, 1.0, atol=0.15)
    assert np.mean([f.sigma for f in fits]) == pytest.approx(2e-6, rel=0.05)


def test_the_geometric_fit_beats_the_algebraic_start() -> None:
    rng = np.random.default_rng(2)
    points = cap(rng, 31, 0.5) + 2e-4 * rng.standard_normal((31, 3))
    centre, radius = algebraic_sphere(points)
    start = np.sum((np.linalg.norm(points - centre, axis=1) - radius) ** 2)
    assert np.sum(fit_sphere(points).residual ** 2) < start


@pytest.mark.parametrize("seed", range(4))
def test_base_and_tooling_ball_calibrate_to_the_sphere(seed: int) -> None:
    """Table 3.4: the two methods agree to numerical accuracy; here to a tenth of a nanometre."""
    _, data = published_table(seed)
    fit = fit_sphere(data.position)
    base = calibrate(ErrorModel(JOINT, ()), prepare(JOINT, data), robust=False)
    lever = base.placement.tool[""][:3, 3] + np.asarray(JOINT.tooling_ball)
    np.testing.assert_allclose(base.placement.registration[""][:3, 3], fit.centre, atol=1e-10)
    assert np.linalg.norm(lever) == pytest.approx(fit.radius, abs=1e-10)
    np.testing.assert_allclose(base.error, np.abs(fit.residual), atol=1e-9)
    assert (base.rank, base.status) == (4, "converged")


def flat() -> np.ndarray:
    return np.column_stack([np.random.default_rng(3).uniform(0, 0.05, (20, 2)), np.full(20, 0.1)])


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (cap(np.random.default_rng(4), 3, 1.0), "3 measured poses"),
        (flat(), "one plane"),
        (np.tile(CENTRE, (31, 1)), "one pose repeated 31 times"),
        (np.repeat(cap(np.random.default_rng(5), 3, 1.0), 9, axis=0), "only 3 different points"),
        (np.full((8, 3), np.nan), "expected finite"),
    ],
    ids=["three", "coplanar", "repeated", "three different", "nan"],
)
def test_points_that_determine_no_sphere_are_refused_in_one_line(points: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        fit_sphere(points, "cmm.csv")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("cmm.csv")


LOBES = "out-of-round ball, 3 lobes over J2, lift along the lever"


@pytest.mark.long
def test_a_rig_whose_tool_is_off_the_axis_can_be_handed_over(tmp_path: Path) -> None:
    made = gp.simulate("spherical-joint", [f"{LOBES}=12 um"], poses=80, noise="1 um", seed=5)
    gp.calibrate("spherical-joint", made.table, [LOBES], holdout=0).model.save(tmp_path / "model.json")
    rig = gp.load_model(tmp_path).saved
    given = ball_priors("L3.fixed", rig, gp.load_mechanism("tau"))
    known = [e for e in rig.model.effects if e.name.startswith("out-of-round")]
    assert len(given) == len(known)
    for effect, other in zip(given, known, strict=True):
        at = rig.model.effects.index(other)
        assert (effect.mean, effect.prior) == pytest.approx((float(rig.theta[at]), float(rig.stderr[at])))
