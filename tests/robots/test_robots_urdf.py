"""Test chains read from URDF against Pinocchio."""

import re
from dataclasses import replace
from pathlib import Path

import example_robot_data
import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from robots_cases import ODD_URDF, poses, slot_frames

from gpmodel.checks.notes import not_read
from gpmodel.errors import InputError
from gpmodel.table.read import dataset_from
from robots import load_mechanism
from robots.library import EXAMPLE_ARMS
from robots.urdf import read_urdf
from robots.urdf_tree import LARGEST_FILE

LINK = '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
JOINT = (
    LINK + '<child link="b"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
)


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    path = tmp_path / "odd.urdf"
    path.write_text(ODD_URDF)
    return path


def whole_configuration(model: pin.Model, values: dict[str, float]) -> np.ndarray:
    configuration = pin.neutral(model)
    for name, value in values.items():
        joint = model.joints[model.getJointId(name)]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
    return configuration


@pytest.mark.parametrize("name", EXAMPLE_ARMS)
def test_example_arm_agrees_with_pinocchio(name: str) -> None:
    file, frame = EXAMPLE_ARMS[name]
    model = pin.buildModelFromUrdf(f"{example_robot_data.getModelPath(file)}/{file}")
    data = model.createData()
    arm = load_mechanism(name)
    assert arm is not None
    q = poses(arm, np.random.default_rng(5), 20)
    frames = slot_frames(arm, q)
    torques = arm.loads(q, np.zeros(20))
    for row, values in enumerate(q):
        configuration = whole_configuration(model, dict(zip(arm.joint_names, values, strict=True)))
        pin.framesForwardKinematics(model, data, configuration)
        placement = data.oMf[model.getFrameId(frame, pin.FrameType.BODY)].homogeneous
        np.testing.assert_allclose(frames[-1, row], placement, atol=1e-9)
        holding = pin.rnea(model, data, configuration, np.zeros(model.nv), np.zeros(model.nv))
        for joint in arm.joint_names:
            expected = -holding[model.joints[model.getJointId(joint)].idx_v]
            np.testing.assert_allclose(torques[f"torque_{joint}"][row], expected, atol=1e-9)


def test_every_kind_of_joint_is_placed_as_pinocchio_does(odd: Path) -> None:
    arm = read_urdf(odd)
    assert arm.joint_names == ("swing", "lift", "turn")
    assert arm.tool_frame == "tip"
    assert [joint.kind for joint in arm.joints] == ["revolute", "prismatic", "revolute"]
    np.testing.assert_array_equal(arm.limits, [[-np.inf, np.inf], [-0.2, 0.4], [-1.0, 2.0]])
    assert arm.joints[0].drive == (("swing.moving", "Rz", 1.0), ("follow.moving", "Rz", -0.5))
    assert arm.joints[1].drive == (("lift.moving", "Tz", -1.0),)
    assert arm.joints[2].drive == (("turn.moving", "Rx", -1.0),)
    model = pin.buildModelFromUrdf(str(odd))
    data = model.createData()
    q = poses(arm, np.random.default_rng(6), 10)
    loads, frames = arm.loads(q, np.zeros(10)), slot_frames(arm, q)
    for row, (swing, lift, turn) in enumerate(q):
        values = {"swing": swing, "lift": lift, "follow": 0.3 - 0.5 * swing, "turn": turn}
        configuration = whole_configuration(model, values)
        pin.framesForwardKinematics(model, data, configuration)
        np.testing.assert_allclose(frames[-1, row], data.oMf[model.getFrameId("tip")].homogeneous, atol=1e-12)
        holding = pin.rnea(model, data, configuration, np.zeros(model.nv), np.zeros(model.nv))
        by_joint = {name: -holding[model.joints[model.getJointId(name)].idx_v] for name in values}
        np.testing.assert_allclose(loads["torque_swing"][row], by_joint["swing"] - 0.5 * by_joint["follow"], atol=1e-9)
        np.testing.assert_allclose(loads["torque_lift"][row], by_joint["lift"], atol=1e-9)
        np.testing.assert_allclose(loads["torque_turn"][row], by_joint["turn"], atol=1e-9)
        np.testing.assert_allclose(loads["force_base_z"][row], -9.81 * 13.5, rtol=1e-12)


def test_a_mimic_joint_needs_no_limit_and_a_calibration_is_said_not_to_be_read(odd: Path, tmp_path: Path) -> None:
    text = re.sub(r'<limit lower="-3"[^>]*>', "", ODD_URDF)
    (tmp_path / "bare.urdf").write_text(text.replace('<axis xyz="-1', '<calibration rising="0.3"/><axis xyz="-1'))
    arm, before = read_urdf(tmp_path / "bare.urdf"), read_urdf(odd)
    np.testing.assert_array_equal(arm.coupling, before.coupling)
    assert (before.not_read, arm.not_read) == ((), ("<calibration> of joint turn",))


def test_the_column_of_a_joint_that_follows_another_is_not_read_and_check_says_so(odd: Path) -> None:
    arm = read_urdf(odd)
    frame = pd.DataFrame({f"{name} [{unit}]": ["0.1"] for name, unit in zip(
        ("swing", "lift", "turn", "follow", "x"), ("rad", "m", "rad", "deg", "mm"), strict=True)})  # fmt: skip
    data = dataset_from(frame, Path("t.csv"), arm)
    assert (data.ignored, data.extras) == (("follow",), {})
    assert list(not_read(arm, data)) == ["follow follows swing; the column of follow is ignored"]
    described = replace(arm, not_read=("<calibration> of joint turn",))
    assert list(not_read(described, data))[1:] == ["ignored in the description of odd: <calibration> of joint turn"]


def test_frame_chooses_the_chain(odd: Path) -> None:
    flap = read_urdf(odd, frame="flap")
    assert flap.joint_names == ("swing", "lift", "flap")
    carriage = read_urdf(odd, frame="carriage")
    assert carriage.joint_names == ("swing", "lift")
    q = np.array([[0.4, 0.1]])
    assert carriage.loads(q, np.zeros(1))["force_base_z"] == pytest.approx(-9.81 * 13.5)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("panda", "panda_hand_tcp"), ("ur5", "tool0"), ("xarm7", "link_eef"), ("ur10", "tool0")],
)
def test_default_frame_is_the_last_link_of_the_arm_not_of_its_fingers(name: str, expected: str) -> None:
    file, _ = EXAMPLE_ARMS[name]
    assert read_urdf(Path(example_robot_data.getModelPath(file)) / file).tool_frame == expected


def test_default_frame_stops_before_a_gripper_that_turns() -> None:
    file = "ur_description/urdf/ur5_gripper.urdf"
    arm = read_urdf(Path(example_robot_data.getModelPath(file)) / file)
    assert len(arm.joint_names) == 6
    assert arm.tool_frame == "tool0"


FIXED = '<joint name="k" type="fixed"><parent link="a"/><child link="b"/></joint>'
WEIGHT = '<inertial><mass value="{}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def weighing(mass: object) -> str:
    return JOINT.replace('<link name="b"/>', f'<link name="b">{WEIGHT.format(mass)}</link>')


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "not well-formed XML"),
        ("<robot><link", "not well-formed XML"),
        ("<html/>", "expected <robot>"),
        ('<robot name="r"/>', "no <link> elements"),
        ('<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>', "xacro"),
        (JOINT.replace('child link="b"', 'child link="c"'), "an unknown link 'c'; expected one of"),
        (JOINT.replace("0 0 1", "0 zero 1"), "'0 zero 1'|'zero'"),
        (JOINT.replace("0 0 1", "0 0 0"), "axis 0 0 0; expected a vector longer than zero"),
        (JOINT.replace("revolute", "hinged"), "hinged"),
        (JOINT.replace("revolute", "fixed"), "no moving joint between .*; expected a link beyond a joint"),
        (JOINT.replace("<axis", '<mimic joint="j" multiplier="two"/><axis'), "two"),
        (JOINT.replace("<axis", '<mimic joint="j" multiplier="1e300"/><axis'), "expected at most 1000"),
        (JOINT.replace("<axis", '<mimic joint="j" offset="1e300"/><axis'), "expected at most 1000"),
        (JOINT.replace("<axis", '<mimic joint="j"/><axis'), "mimics"),
        (JOINT.replace("<limit", "<nolimit"), "no <limit>"),
        (JOINT.replace('"-1" upper="1"', '"-150" upper="150"'), "limits -150 to 150 rad look like degrees; expected"),
        (JOINT.replace("joint", "Joint"), "element <Joint> is unknown; expected <joint>"),
        (JOINT.replace("<axis", "<Axis"), "element <Axis> is unknown; expected <axis>"),
        (JOINT.replace('lower="-1"', 'lower="2"'), r"joint 'j': lower limit 2 above upper limit 1; expected lower"),
        (weighing(-3), "weighs: -3 kg; expected"),
        (weighing(1e5), "100000 kg; expected a mass"),
        (weighing("nan"), "a mass is 'nan', expected a finite number"),
        (JOINT.replace("revolute", "floating"), "joint 'j' is floating"),
        (JOINT.replace("revolute", "planar"), "joint 'j' is planar"),
        (JOINT.replace("<axis", '<mimic joint="nope"/><axis'), "'nope', which is no moving joint of the file"),
        (JOINT.replace("<axis", '<origin xyz="0 0 1e200"/><axis'), r"1e\+200 m; expected at most 1000 m"),
        (JOINT.replace("<axis", '<origin rpy="1e300 0 0"/><axis'), r"1e\+300 rad; expected at most"),
        (JOINT.replace("</robot>", f"{FIXED}</robot>"), "'b' is the child of two joints"),
        (JOINT.replace("</robot>", '<link name="c"/></robot>'), "a, c without a parent; expected one"),
    ],
)
def test_bad_file_is_one_line_and_nothing_printed(
    content: str, complaint: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.urdf"
    path.write_text(content)
    with pytest.raises(InputError, match=complaint) as caught:
        read_urdf(path)
    assert "\n" not in str(caught.value)
    assert "bad.urdf" in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("title", "called"), [("heavy 6", "heavy 6"), ("", "arm"), ("a&#10;b", "arm"), ("x" * 99, "arm")]
)
def test_an_arm_is_called_as_its_robot_is_where_that_titles_a_page(tmp_path: Path, title: str, called: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(JOINT.replace('name="r"', f'name="{title}"'))
    assert read_urdf(path).name == called


def test_missing_file_and_unknown_frame(tmp_path: Path, odd: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_urdf(tmp_path / "none.urdf")
    with pytest.raises(InputError, match=r"no link named 'flange'; expected one of .*flap, .* others"):
        read_urdf(odd, frame="flange")
    with pytest.raises(InputError, match="no moving joint"):
        read_urdf(odd, frame="bench")


def chain_of(joints: int) -> str:
    """A URDF of so many joints in a row."""
    link = '<link name="l{}"/>'
    joint = '<joint name="j{0}" type="continuous"><parent link="l{0}"/><child link="l{1}"/><axis xyz="0 0 1"/></joint>'
    parts = [link.format(0), *(link.format(k + 1) + joint.format(k, k + 1) for k in range(joints))]
    return f'<robot name="snake">{"".join(parts)}</robot>'


BILLION = "<!DOCTYPE robot [<!ENTITY a0 'ha'>" + "".join(
    f"<!ENTITY a{k} '{10 * f'&a{k - 1};'}'>" for k in range(1, 12)
)  # fmt: skip
BOMBS = {
    "entities": (f"{BILLION}]><robot>&a11;</robot>", "document type"),
    "a file of the machine": ('<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/hostname">]><robot>&x;</robot>', "document"),
    "a document elsewhere": ('<!DOCTYPE robot SYSTEM "http://localhost/r.dtd"><robot/>', "document type"),
    "depth": (f"<robot>{100_000 * '<a>'}{100_000 * '</a>'}</robot>", "the URDF cannot be read"),
    "joints": (chain_of(5000), "more than 300 joints"),
    "a long chain": (chain_of(65), "65 moving joints to 'l65', expected at most 64"),
}


@pytest.mark.parametrize("kind", BOMBS)
def test_a_description_that_grows_when_it_is_read_is_refused(kind: str, tmp_path: Path) -> None:
    text, said = BOMBS[kind]
    path = tmp_path / "bomb.urdf"
    path.write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        read_urdf(path)
    assert "\n" not in str(caught.value)


def test_a_file_too_large_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "large.urdf").open("wb") as file:
        file.truncate(LARGEST_FILE + 1)
    with pytest.raises(InputError, match="larger than 16 MB"):
        read_urdf(tmp_path / "large.urdf")


def test_an_axis_of_any_length_is_a_direction(tmp_path: Path) -> None:
    q, found = np.array([[0.3]]), []
    for length in ("0 0 1", "0 0 1e300"):
        path = tmp_path / "arm.urdf"
        path.write_text(JOINT.replace("0 0 1", length))
        found.append(read_urdf(path).transforms(q))
    np.testing.assert_array_equal(*found)
