"""The blind robots are what they claim: closed forms, energies, sizes, and an oracle at the noise."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from experiments.blind.arms import ARMS
from experiments.blind.cases import CASES
from experiments.blind.description import urdf
from experiments.blind.effects import KINDS
from experiments.blind.files import write
from experiments.blind.generate import make
from experiments.blind.grading import answers, innocent
from experiments.blind.judge import judge
from experiments.blind.machine import world_of
from experiments.blind.oracle import left_by, register
from experiments.blind.simulator import GRAVITY, frames, gravity_loads, points, small_motion
from gpmodel.table.read import read_table
from robots import load_mechanism

QUICK = {"base", "eccentric_1", "setup_step", "windup_3", "approach_2", "null_outliers"}
EFFECTS = [name for name, case in CASES.items() if case.effects]
NULLS = [name for name, case in CASES.items() if not case.effects]


def unless_quick(names):
    """Every case is checked; those outside QUICK only with the slow tests."""
    return [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in names]


def random_angles(arm, count=5):
    return np.random.default_rng(1).uniform(arm.limits[:, 0], arm.limits[:, 1], (count, len(arm.rows)))


def potential(arm, q):
    placed = frames(arm, q)
    heights = [placed[i + 1][:, 2, :3] @ c + placed[i + 1][:, 2, 3] for i, c in enumerate(arm.centres)]
    return -GRAVITY[2] * sum(m * h for m, h in zip(arm.masses, heights, strict=True))


@pytest.mark.parametrize("name", ARMS)
def test_torque_is_the_slope_of_the_potential_energy(name):
    arm = ARMS[name]
    q = random_angles(arm)
    torque = gravity_loads(arm, q).torque
    for joint in range(len(arm.rows)):
        shift = np.eye(len(arm.rows))[joint] * 1e-5
        slope = (potential(arm, q + shift) - potential(arm, q - shift)) / 2e-5
        np.testing.assert_allclose(torque[:, joint], -slope, atol=1e-5)


def test_a_payload_weighs_as_a_last_link_at_the_tool_point():
    arm, tool = ARMS["irb_like"], np.array([0.1, -0.05, 0.2])
    q = random_angles(arm)
    loaded = gravity_loads(arm, q, np.full(len(q), 12.0), tool)
    mass = arm.masses[-1] + 12.0
    centres = arm.centres.copy()
    centres[-1] = (arm.masses[-1] * centres[-1] + 12.0 * tool) / mass
    heavier = replace(arm, masses=np.append(arm.masses[:-1], mass), centres=centres)
    np.testing.assert_allclose(loaded.moments, gravity_loads(heavier, q).moments, atol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_the_written_description_is_the_same_arm(name, tmp_path):
    """Flange and gravity torques of the URDF, as another program reads them."""
    arm = ARMS[name]
    (tmp_path / "robot.urdf").write_text(urdf(arm))
    mechanism = load_mechanism(str(tmp_path / "robot.urdf"))
    q = random_angles(arm)
    steps = mechanism.transforms(q)
    flange = steps[0]
    for step in steps[1:]:
        flange = flange @ step
    np.testing.assert_allclose(flange, frames(arm, q)[-1], atol=1e-9)
    theirs = mechanism.loads(q, np.zeros(len(q)))
    ours = gravity_loads(arm, q)
    for i, joint in enumerate(arm.joints):
        np.testing.assert_allclose(theirs[f"torque_{joint}"], ours.torque[:, i], rtol=1e-3, atol=0.1)
    np.testing.assert_allclose(theirs["moment_base_y"], ours.moments[0][:, 1], rtol=1e-3, atol=0.1)


def test_a_small_motion_is_rigid_and_turns_by_its_vector():
    twist = np.array([[0.1, 0.2, 0.3, 0.0, 0.0, np.pi / 2], [0, 0, 0, 0, 0, 0]])
    motion = small_motion(twist)
    np.testing.assert_allclose(motion[0] @ [1, 0, 0, 1], [0.1, 1.2, 0.3, 1], atol=1e-15)
    np.testing.assert_array_equal(motion[1], np.eye(4))


@pytest.mark.parametrize("name", ARMS)
def test_registration_and_tool_of_an_innocent_robot_are_recovered(name):
    arm = ARMS[name]
    q = random_angles(arm, 40)
    placement = small_motion(np.array([[2.0, -1.0, 0.5, 2.0, -1.0, 1.0]]))[0]
    tool = np.array([0.15, -0.2, 0.1])
    measured = points(arm, q, placement, tool, {})
    found, found_tool = register(arm, q, measured)
    np.testing.assert_allclose(points(arm, q, found, found_tool, {}), measured, atol=1e-8)


@pytest.mark.parametrize("name", unless_quick(EFFECTS))
def test_an_effect_leaves_what_it_should_and_the_oracle_takes_it_away(name):
    case = CASES[name]
    robot = make(case, 3)
    errors = judge(robot)
    expected = np.hypot(np.sqrt(sum(size**2 for _, _, size in case.effects)), np.sqrt(3) * case.noise_mm)
    assert 0.6 * expected < errors["geometric_train_mm"] < 1.5 * expected
    assert errors["oracle_clean_mm"] < np.sqrt(3) * case.noise_mm
    assert errors["oracle_noisy_mm"] < 1.35 * np.sqrt(3) * case.noise_mm
    assert errors["oracle_clean_mm"] < 0.75 * errors["geometric_clean_mm"]


@pytest.mark.parametrize("name", unless_quick(NULLS))
def test_nothing_undeclared_leaves_the_noise(name):
    case = CASES[name]
    errors = judge(make(case, 3))
    assert errors["oracle_clean_mm"] == errors["geometric_clean_mm"]
    assert 0.75 < errors["geometric_train_mm"] / (np.sqrt(3) * case.noise_mm) < 1.05


@pytest.mark.parametrize("name", ["base", "setup_step", "windup_3", "payload_and_approach"])
def test_amounts_match_the_requested_sizes(name):
    """Measured afresh, on this robot's own poses and not on those the amounts were set with."""
    robot = make(CASES[name], 5)
    for shape, amount, (_, _, size) in zip(robot.shapes, robot.amounts, robot.case.effects, strict=True):
        sheet = robot.train
        world = world_of(robot.arm, sheet.q, sheet.extra, sheet.row, robot.tool)
        rest = left_by(robot.arm, sheet.q, robot.placement, robot.tool, shape.true(world))
        assert 0.7 < 1e3 * amount * rest / size < 1.3


def test_every_kind_of_effect_has_a_case_and_both_halves_have_three_nulls():
    used = {kind for case in CASES.values() for kind, _, _ in case.effects}
    assert used == set(KINDS)
    assert min(sum(CASES[n].aside == half for n in NULLS) for half in (True, False)) >= 3


def test_the_same_seed_writes_the_same_files_and_another_does_not(tmp_path):
    case = CASES["setup_step"]
    for folder, seed in (("a", 0), ("b", 0), ("c", 1)):
        write(make(case, seed), tmp_path / folder)
    a, b, c = ((tmp_path / f / "table.csv").read_text() for f in "abc")
    assert a == b != c
    truth = json.loads((tmp_path / "a" / "truth.json").read_text())
    assert truth["fresh"] == [f"fresh_{k}" for k in range(6)]
    assert a.splitlines()[0].endswith("J6 [deg],x [mm],y [mm],z [mm]")


def test_the_written_table_reads_back(tmp_path):
    robot = make(CASES["payload_and_approach"], 0)
    write(robot, tmp_path)
    table = read_table(tmp_path / "table.csv", load_mechanism(str(tmp_path / "robot.urdf")))
    np.testing.assert_allclose(table.position, robot.train.measured, atol=1e-8)
    np.testing.assert_allclose(table.q, robot.train.q, atol=1e-12)
    np.testing.assert_array_equal(table.payload, robot.train.extra["payload"])
    assert set(table.extras) == {"approach_J2", "humidity"}


def test_outliers_are_the_listed_rows():
    robot = make(CASES["null_outliers"], 0)
    off = np.linalg.norm(robot.train.measured - robot.train.clean, axis=1)
    assert len(robot.train.outliers) == 2
    assert sorted(np.argsort(off)[-2:]) == robot.train.outliers.tolist()


@pytest.mark.parametrize(
    ("wanted", "inputs", "right"),
    [
        ([["torque_J3"], ["J2", "J3"]], ["J3", "J2"], True),
        ([["torque_J3"], ["J2", "J3"]], ["J3"], False),
        ([["moment_base_?"]], ["moment_base_x"], True),
        ([["J5", "J[2-6]"]], ["J5"], False),
        ([["row"]], [], False),
    ],
)
def test_right_answers(wanted, inputs, right):
    assert answers(wanted, inputs) is right


def test_an_effect_on_a_distractor_is_a_false_addition():
    truth = [{"named": [["J4"]]}]
    assert innocent(["humidity"], truth)
    assert not innocent(["J4", "humidity"], truth)
    assert innocent(["J4"], [])
