"""Test the grading of findings, and results that survive an interruption."""

import json
from dataclasses import replace

import numpy as np
import pytest

from experiments.blind.arms import ARMS
from experiments.blind.cases import CASES
from experiments.blind.files import urdf, write
from experiments.blind.generate import make
from experiments.blind.grading import answers, deviations, false, grade, innocent, nodes, readable, worse
from experiments.blind.oracle import Fit, jacobian, register
from experiments.blind.shapes import shift
from experiments.blind.simulator import GRAVITY, frames, gravity_loads, points, small_motion, weight_regressor
from gpmodel.api.table import read_table
from robots import load_mechanism


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


DRIFT = {
    "kind": "instrument_drift", "settings": {}, "amount": 1.0, "named": [["row"]], "called": ["*drift*"],
    "place": "instrument", "hidden": False,
}  # fmt: skip
WEAK = {
    "kind": "compliance", "settings": {"joint": 3}, "amount": 2e-6, "named": [["torque_J3"]], "called": [],
    "place": "robot", "hidden": False,
}  # fmt: skip


def finding(name="law", inputs=("J1",), slot="J1.moving", basis="sin(J1)", **more):
    return {"name": name, "inputs": list(inputs), "slot": slot, "basis": basis, "catalogue": None, **more}


@pytest.mark.parametrize(
    ("found", "truth", "wrong"),
    [
        (finding(inputs=["row"], slot="base"), [DRIFT], False),
        (finding(inputs=["row"], slot="J2.moving"), [DRIFT], True),
        (finding("drift of the tracker", ["t"], "instrument"), [DRIFT], False),
        (finding(inputs=["row"], slot="J2.moving"), [], True),
        (finding(inputs=["torque_J3"], slot="J3.moving"), [DRIFT, WEAK], False),
        (finding(inputs=["J3"], slot="J3.moving"), [WEAK], True),
    ],
)
def test_an_effect_of_the_instrument_at_the_robot_is_false(found, truth, wrong):
    assert false(found, truth) is wrong


@pytest.mark.parametrize(
    ("law", "count"),
    [
        ("sin(J1)", 2),
        ("sin(2*J1 + 0.3)", 2),
        ("(row - 44.41) / 25.9 / exp((row - 44.41) / 25.9)", 4),
        ("tanh(J2) * cos(J5) + J3", 7),
        ("max(0.35, torque_J2 / 182.0) and min(-0.35, torque_J2 / 182.0)", 6),
        ("2 / exp(time)", 4),
        ("curve of J2, 10 harmonics", 25),
    ],
)
def test_nodes_of_a_law(law, count):
    assert nodes(law) == count


def test_a_name_or_a_short_law_is_readable():
    long = "tanh(max(J2, J3)) * exp(J2) * cos(J3)"
    assert readable(finding())
    assert not readable(finding(basis=long))
    assert readable(finding(basis=long, catalogue="joint_compliance"))
    assert not readable(finding(inputs=["J1", "J2", "J3"], basis="J1 * J2 * J3"))


def test_deviations_need_the_right_joint_and_unit():
    truth = {"case": {"masses_off": 0.0}, "effects": [WEAK]}
    right = finding(
        "joint compliance, J3", ["torque_J3"], "J3.moving", "torque_J3",
        value=2.2e-6, stderr=1e-7, unit="rad/Nm", catalogue="joint_compliance",
    )  # fmt: skip
    assert deviations([right], truth) == pytest.approx([2.0])
    assert deviations([{**right, "slot": "J2.moving"}], truth) == []
    assert deviations([{**right, "unit": "m/N"}], truth) == []


@pytest.mark.parametrize(
    ("turns", "basis", "counts"), [(1, "sin(J3 +1.2)", 1), (2, "sin(J3 +1.2)", 0), (1, "sin(J3)", 0)]
)
def test_an_amplitude_is_compared_with_its_own_pair(turns, basis, counts):
    truth = {**WEAK, "kind": "harmonic", "settings": {"joint": 3, "per_turn": turns}, "named": [["J3"]]}
    pair = finding("eccentricity", ["J3"], "J3.moving", basis, value=1e-4, stderr=1e-5, unit="rad", catalogue="e")
    assert len(deviations([pair], {"case": {"masses_off": 0.0}, "effects": [truth]})) == counts


def test_every_effect_is_counted_by_itself_and_hidden_ones_are_not():
    truth = {"case": {"masses_off": 0.0}, "effects": [WEAK, {**DRIFT, "hidden": True}]}
    graded = grade([finding(inputs=["torque_J3"], unit="", value=0.0)], truth)
    assert (graded["effects"], graded["effects_named"], graded["named"], graded["false"]) == (1, 1, True, 0)


def test_worse_is_judged_pose_by_pose():
    standard = np.random.default_rng(0).normal(size=(400, 3))
    assert worse(1.05 * standard, standard)
    assert not worse(1.0001 * standard, standard)
    assert not worse(np.random.default_rng(1).normal(size=(400, 3)), standard)


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


@pytest.mark.parametrize("name", ["irb_like", "seven_tilted", "welder"])
def test_torque_is_linear_in_mass_moments_fixed_in_the_frames(name):
    """Frame i carries m_i c_i and, at the next joint, all masses beyond."""
    arm = ARMS[name]
    q = random_angles(arm)
    ahead = np.vstack([arm.origins()[1:, :3, 3], np.zeros(3)])
    beyond = np.append(np.cumsum(arm.masses[::-1])[::-1][1:], 0.0)
    moments = arm.masses[:, None] * arm.centres + beyond[:, None] * ahead
    for joint in range(1, len(arm.rows) + 1):
        predicted = weight_regressor(arm, q, joint) @ moments[joint - 1 :].ravel()
        np.testing.assert_allclose(predicted, gravity_loads(arm, q).torque[:, joint - 1], atol=1e-9)


@pytest.mark.first(2)
@pytest.mark.parametrize("name", ["irb_like", "seven_tilted", "rail_kuka", "gantry", "scara"])
def test_columns_agree_with_differences(name):
    arm, rng = ARMS[name], np.random.default_rng(2)
    q = random_angles(arm, 12)
    placement, tool = small_motion(np.array([[2.0, -1.0, 0.5, 0.3, -0.2, 1.0]]))[0], np.array([0.1, -0.2, 0.1])
    columns = [{1: rng.normal(size=(12, 6)), 3: rng.normal(size=(12, 6))}, shift(rng.normal(size=(12, 3)))]
    unknowns = 9 + 6 * len(arm.rows) + len(columns)

    def predict(x):
        return Fit(arm, placement, tool, x).predict(q, columns).ravel()

    for x, tolerance in ((np.zeros(unknowns), 1e-8), (rng.uniform(-1e-3, 1e-3, unknowns), 1e-2)):
        steps = 1e-6 * np.eye(unknowns)
        slopes = np.array([(predict(x + step) - predict(x - step)) / 2e-6 for step in steps]).T
        np.testing.assert_allclose(jacobian(arm, placement, tool, x, q, columns), slopes, atol=tolerance)


def test_a_small_motion_is_rigid_and_turns_by_its_vector():
    twist = np.array([[0.1, 0.2, 0.3, 0.0, 0.0, np.pi / 2], [0, 0, 0, 0, 0, 0]])
    motion = small_motion(twist)
    np.testing.assert_allclose(motion[0] @ [1, 0, 0, 1], [0.1, 1.2, 0.3, 1], atol=1e-15)
    np.testing.assert_array_equal(motion[1], np.eye(4))


@pytest.mark.parametrize("name", sorted(set(ARMS) - {"scara"}))
def test_registration_and_tool_of_an_innocent_robot_are_recovered(name):
    arm = ARMS[name]
    q = random_angles(arm, 40)
    placement = small_motion(np.array([[2.0, -1.0, 0.5, 2.0, -1.0, 1.0]]))[0]
    tool = np.array([0.15, -0.2, 0.1])
    measured = points(arm, q, placement, tool, {})
    found, found_tool = register(arm, q, measured)
    np.testing.assert_allclose(points(arm, q, found, found_tool, {}), measured, atol=1e-8)


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
