"""Test the families of blind robots: stated sizes, oracles at the noise, sessions and instruments."""

import json

import numpy as np
import pytest

from experiments.blind.arms import ARMS
from experiments.blind.cases import CASES, FAMILIES
from experiments.blind.effects import KINDS, draw
from experiments.blind.files import write
from experiments.blind.generate import make
from experiments.blind.instrument import along_azimuth, along_elevation, polar
from experiments.blind.judge import judge
from experiments.blind.memory import direction, lag, stop_operator
from experiments.blind.oracle import left_by
from experiments.blind.robot import world_of
from experiments.blind.simulator import gravity_loads, small_motion
from gpmodel.api.table import read_table
from robots import load_mechanism

SINGLE = {"base", "eccentric_1", "setup_step", "windup_3", "approach_2", "null_outliers"}
BY_SESSION = {"lagging_structure", "friction_windup", "azimuth_eccentric", "instrument_drift"}
SCATTERED = {"clusters": 1.8, "walk": 1.6, "student": 1.5}


def unless_quick(names):
    """Every case is checked: single ones of SINGLE, small ones with the long tests, all others with the slow tests."""
    small = {n for n, c in CASES.items() if c.family != "single" and not c.aside and c.poses <= 250}
    marks = {n: () if n in SINGLE else pytest.mark.long if n in small else pytest.mark.slow for n in names}
    return [pytest.param(name, marks=marks[name]) for name in names]


def noise(case):
    return np.sqrt(3) * np.hypot(case.noise_mm, case.shared_mm)


@pytest.mark.parametrize("name", unless_quick(CASES))
def test_geometry_leaves_what_it_should_and_the_oracle_the_noise(name):
    case = CASES[name]
    errors = judge(make(case, 3)).errors
    size = np.sqrt(sum(size**2 for _, _, size in case.effects) + case.walk_mm**2)
    wide = BY_SESSION & {kind for kind, _, _ in case.effects} or case.noise == "student"
    low, high = (0.4, 2.0) if wide else (0.65, 1.5)
    assert low < errors["geometric_train_mm"] / np.hypot(size, noise(case)) < high
    kind = "walk" if case.walk_mm else "student" if case.noise == "student" else case.order
    assert errors["oracle_noisy_mm"] < SCATTERED.get(kind, 1.35) * noise(case)
    if any(size for _, _, size in case.effects):
        assert errors["oracle_clean_mm"] < 0.75 * errors["geometric_clean_mm"]


@pytest.mark.parametrize("name", unless_quick([n for n, c in CASES.items() if not c.effects]))
def test_on_an_innocent_robot_oracle_and_geometry_are_one(name):
    errors = judge(make(CASES[name], 4)).errors
    for where in ("train", "clean", "noisy"):
        assert errors[f"oracle_{where}_mm"] == errors[f"geometric_{where}_mm"]


@pytest.mark.parametrize(
    "name", ["base", "setup_step", "payload_and_approach", "four_150", "hysteresis_2", "gantry_screws"]
)
def test_amounts_match_the_requested_sizes(name):
    """Measured afresh, on this robot's own poses and not on those the amounts were set with."""
    robot = make(CASES[name], 5)
    sheet = robot.train
    world = world_of(robot.arm, sheet.q, sheet.extra, sheet.row, robot.tool, robot.placement)
    for shape, amount, (_, _, size) in zip(robot.shapes, robot.amounts, robot.case.effects, strict=True):
        rest = left_by(robot.arm, sheet.q, robot.placement, robot.tool, shape.true(world))
        assert 0.7 < 1e3 * amount * rest / size < 1.3


def test_every_kind_has_a_case_and_every_family_both_halves():
    assert {kind for case in CASES.values() for kind, _, _ in case.effects} == set(KINDS)
    halves = {(case.family, case.aside) for case in CASES.values()}
    assert halves == {(family, aside) for family in FAMILIES for aside in (True, False)}
    assert {case.arm for case in CASES.values()} == set(ARMS)


def test_direction_of_the_last_move_is_kept_while_nothing_moves():
    np.testing.assert_array_equal(direction(np.array([1.0, 1.0, 2.0, 2.0, 0.0]), 1.0), [0, 0, 1, 1, -1])
    np.testing.assert_array_equal(direction(np.array([1.0, 2.0]), 3.0), [-1, 1])


def test_a_stop_winds_up_to_its_radius_and_turns_back_at_once():
    np.testing.assert_allclose(stop_operator(np.array([0.0, 0.2, 1.0, 0.9, 0.0]), 0.3), [0, 0.2, 0.3, 0.2, -0.3])


def test_a_lag_follows_a_ramp_behind_by_its_time_constant():
    time = np.cumsum(np.random.default_rng(0).uniform(0.5, 3.0, 100))
    time -= time[0]
    np.testing.assert_allclose(lag(time, time, 40.0), time - 40.0 * (1.0 - np.exp(-time / 40.0)), atol=1e-12)
    np.testing.assert_allclose(lag(np.full(100, 3.0), time, 40.0), 3.0)


def test_angles_of_the_instrument_move_a_point_along_themselves():
    point = np.random.default_rng(1).normal(size=(20, 3)) * 3
    small = np.full(20, 1e-7)
    for k, moved in ((1, along_azimuth(point, small)), (2, along_elevation(point, small))):
        change = np.array(polar(point + moved)) - np.array(polar(point))
        expected = np.zeros((3, 20))
        expected[k] = 1e-7
        np.testing.assert_allclose(change, expected, atol=1e-12)


def test_a_scale_of_the_range_hides_in_the_geometry_and_an_offset_does_not():
    robot = make("range_scale", 0)
    sheet = robot.train
    world = world_of(robot.arm, sheet.q, sheet.extra, sheet.row, robot.tool, robot.placement)
    offset = draw("range_offset", robot.arm, np.random.default_rng(0))
    left = [left_by(robot.arm, sheet.q, robot.placement, robot.tool, s.true(world)) for s in (robot.shapes[0], offset)]
    assert left[0] < 1e-9
    assert left[1] > 1e-2


def test_repeats_come_in_rounds_with_or_without_a_label(tmp_path):
    labelled, jitter = make("repeats_labelled", 0, tmp_path), make("repeats_jitter", 0)
    q = labelled.train.q
    np.testing.assert_array_equal(q[:60], q[60:120])
    mechanism = load_mechanism(str(tmp_path / "robot.urdf"))
    assert read_table(tmp_path / "table.csv", mechanism).labels["repeat"][[0, 60, 61]].tolist() == ["p0", "p0", "p1"]
    gap = jitter.train.q[:60] - jitter.train.q[60:120]
    assert 1e-5 < np.std(gap) < 2e-5
    error = (jitter.train.measured - jitter.train.clean).reshape(3, 60, 3)
    assert np.std(error - error.mean(axis=0)) < 0.5 * np.std(error.mean(axis=0))


def test_few_joints_little_room_and_short_moves():
    spread = np.ptp(make("two_move", 0).train.q, axis=0)
    np.testing.assert_array_equal(spread > 1e-9, [False, True, True, False, False, False])
    limits = ARMS["staubli_like"].limits
    assert (np.ptp(make("narrow", 0).train.q, axis=0) <= 0.151 * np.ptp(limits, axis=1)).all()
    moves = np.abs(np.diff(make("small_moves", 0).train.q, axis=0)) / np.ptp(ARMS["ur_like"].limits, axis=1)
    assert np.mean(moves <= 0.2) > 0.9


def test_fresh_poses_lie_inside_and_beyond_the_range_of_the_table(tmp_path):
    robot = make("part_weak", 0, tmp_path)
    edge = robot.train.q[:, 2].max() + 0.05
    assert robot.fresh[0].q[:, 2].max() < edge < robot.beyond[0].q[:, 2].max()
    assert robot.beyond[0].q[:, 2].min() > robot.train.q[:, 2].max() - 0.05
    assert (tmp_path / "beyond_0_noisy.csv").exists()
    assert {"geometric_beyond_noisy_mm", "oracle_beyond_clean_mm"} <= set(judge(robot).errors)


def test_a_walk_has_the_stated_size_and_is_in_the_table_only():
    robot = make("tracker_walk", 0)
    walk = robot.train.measured - robot.train.clean
    assert 0.1 < 1e3 * np.sqrt(np.mean(np.sum(walk**2, axis=1))) < 0.13
    assert np.std(robot.fresh[0].measured - robot.fresh[0].clean) < 0.035e-3


def test_missing_wrong_and_measured_loads(tmp_path):
    make("measured_torque_2", 0, tmp_path)
    assert "mass" not in (tmp_path / "robot.urdf").read_text()
    table = read_table(tmp_path / "table.csv", load_mechanism(str(tmp_path / "robot.urdf")))
    torque = gravity_loads(ARMS["staubli_like"], table.q).torque[:, 1]
    assert np.corrcoef(table.extras["torque_J2"], -torque)[0, 1] > 0.999
    robot = make("wrong_masses_kuka", 0)
    assert robot.arm.masses.tolist() == ARMS["kuka_like"].masses.tolist()
    world = world_of(robot.arm, robot.train.q, {}, robot.train.row, robot.tool)
    parts = [motion[2][:, 5] for motion in robot.shapes[0].basis(world)]
    np.testing.assert_allclose(sum(parts), world.torque(2), atol=1e-9)


def test_a_session_is_as_long_in_the_fresh_files(tmp_path):
    truth = write(make("lag_link", 0), tmp_path, judged=True)
    assert truth["by_row"]
    assert len(truth["fresh"]) == 2
    lines = (tmp_path / "fresh_1.csv").read_text().splitlines()
    assert len(lines) == 201
    assert lines[0].endswith("time [min],temperature [degC]")
    assert json.loads((tmp_path / "truth.json").read_text())["errors"] == truth["errors"]
    assert (tmp_path / "fresh_1_standard.csv").exists()


def test_the_levelled_tracker_stands_upright_and_away():
    for seed in range(5):
        placement = make("azimuth", seed).placement
        assert placement[2, 2] > np.cos(np.radians(5))
        assert 2.5 < np.hypot(*placement[:2, 3]) < 4.0
    assert np.linalg.det(small_motion(np.ones((1, 6)))[0][:3, :3]) == pytest.approx(1.0)
