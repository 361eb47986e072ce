"""Test DH tables in TOML against multiplied rows, and wrong files."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from robots_cases import STANDARD_DH, poses, slot_frames

from gpmodel.arrays import Array
from gpmodel.errors import InputError
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.numerics import se3
from robots.dh import read_dh
from robots.library import irb6400r, load_mechanism

ROW = "[[joint]]\na_mm = 100\n"
MODIFIED = 'convention = "modified"\n'


def turn(axis: int, angle: float) -> Array:
    """Rodrigues' rotation about a coordinate axis, as (4, 4)."""
    cross = np.cross(np.eye(3), np.eye(3)[axis])
    transform = np.eye(4)
    transform[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return transform


def shift(axis: int, length: float) -> Array:
    transform = np.eye(4)
    transform[axis, 3] = length
    return transform


def written(content: str, folder: Path) -> Path:
    path = folder / "arm.toml"
    path.write_text(content)
    return path


def test_standard_rows_multiply_out(tmp_path: Path) -> None:
    arm = read_dh(written(STANDARD_DH, tmp_path))
    assert arm.joint_names == ("J1", "J2", "reach", "J4")
    assert [joint.kind for joint in arm.joints] == ["revolute", "revolute", "prismatic", "revolute"]
    np.testing.assert_array_equal(arm.limits[2], [-0.05, 0.2])
    q = np.array([0.7, -0.4, 0.12, 1.9])
    base = shift(0, 0.01) @ shift(1, 0.02) @ shift(2, 0.03)
    base = base @ turn(2, np.radians(30)) @ turn(1, np.radians(20)) @ turn(0, np.radians(10))
    rows = [
        turn(2, q[0]) @ shift(2, 0.4) @ shift(0, 0.025) @ turn(0, np.pi / 2),
        turn(2, 0.5 - q[1]) @ shift(0, 0.45),
        turn(2, np.radians(15)) @ shift(2, 0.1 + q[2]) @ turn(0, np.radians(-40)),
        turn(2, q[3] + 0.25 * q[0]) @ turn(0, np.pi / 2),
    ]
    expected = np.linalg.multi_dot([base, *rows, shift(2, 0.0254) @ turn(0, 0.1)])
    np.testing.assert_allclose(slot_frames(arm, q[None])[-1, 0], expected, atol=1e-15)
    torque = 20 * np.cross((base @ rows[0] @ [-0.01, 0.0, 0.03, 1.0])[:3], [0.0, 9.81, 0.0])
    second = 9 * np.cross((base @ rows[0] @ rows[1] @ [-0.2, 0.0, 0.01, 1.0])[:3], [0.0, 9.81, 0.0])
    third = 4 * np.cross((base @ rows[0] @ rows[1] @ rows[2])[:3, 3], [0.0, 9.81, 0.0])
    loads = arm.loads(q[None], np.zeros(1))
    moment = [loads[f"moment_base_{side}"][0] for side in "xyz"]
    np.testing.assert_allclose(moment, torque + second + third, atol=1e-12)


def test_modified_rows_multiply_out(tmp_path: Path) -> None:
    arm = read_dh(
        written(
            MODIFIED + "[[joint]]\nalpha_deg = 20\na_mm = 100\nd_in = 2\ntheta_rad = 0.3\n"
            '[[joint]]\nkind = "prismatic"\nalpha_rad = -0.5\na_m = 0.2\nd_mm = 5\ntheta_deg = 10\n',
            tmp_path,
        )
    )
    first = turn(0, np.radians(20)) @ shift(0, 0.1) @ turn(2, 0.3 + 0.6) @ shift(2, 0.0508)
    second = turn(0, -0.5) @ shift(0, 0.2) @ turn(2, np.radians(10)) @ shift(2, 0.005 + 0.07)
    np.testing.assert_allclose(slot_frames(arm, np.array([[0.6, 0.07]]))[-1, 0], first @ second, atol=1e-15)


@pytest.mark.parametrize("first", ["prismatic", "revolute"])
def test_a_joint_has_the_kind_of_its_own_row_whatever_it_drives(first: str, tmp_path: Path) -> None:
    """The spline of a SCARA turns the nut of its screw: the last joint moves the one before it."""
    rows = f"[[joint]]\nkind = '{first}'\na_mm = 300\n{ROW}[[coupling]]\njoint = 'J1'\nfollows = 'J2'\nfactor = 0.003\n"
    assert [joint.kind for joint in read_dh(written(MODIFIED + rows, tmp_path)).joints] == [first, "revolute"]


COUPLING = "[[coupling]]\njoint='J2'\nfollows='J1'\nfactor=1\n"


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("convention = ", "is no TOML"),
        ("", "convention is None, expected one of 'standard', 'modified'"),
        (MODIFIED, "no .*joint.* rows"),
        (ROW, "convention"),
        (MODIFIED + "[joint]\na_mm = 1\n", "double brackets"),
        (MODIFIED + "[[joint]]\na = 100\n", r"\[\[joint\]\] 1: a needs one unit; write one of a_mm, a_m, a_in"),
        (MODIFIED + "[[joint]]\na_mm = 100\na_m = 1\n", "a needs one unit"),
        (MODIFIED + "[[joint]]\na_cm = 100\n", "unknown key a_cm; expected .*a_mm"),
        (MODIFIED + '[[joint]]\na_mm = "long"\n', "'long', expected one finite number"),
        (MODIFIED + "[[joint]]\na_mm = nan\n", "nan, expected one finite number"),
        (MODIFIED + "[[joint]]\nmass_kg = -1\n", "expected a mass from 0"),
        (MODIFIED + "[[joint]]\ncom_mm = [1, 2]\n", "a list of 3 finite numbers"),
        (MODIFIED + "[[joint]]\nkind = 'ball'\n", "'ball', expected one of 'revolute', 'prismatic'"),
        (MODIFIED + "[[joint]]\nsign = 2\n", "sign is 2"),
        (MODIFIED + "[[joint]]\nname = ''\n", "expected a text"),
        (MODIFIED + "[[joint]]\nlower_deg = 5\nupper_deg = -5\n", "lower limit"),
        (MODIFIED + "[[joint]]\nname = 'A'\n[[joint]]\nname = 'A'\n", "repeat"),
        (MODIFIED + ROW + "[tool]\nxyz_mm = 3\n", r"\[tool\]: xyz_mm is 3"),
        (MODIFIED + "tool = 3\n" + ROW, "expected a table"),
        (MODIFIED + ROW + "[[coupling]]\njoint='J2'\nfollows='J1'\nfactor=1\n", "'J2', expected one of 'J1'"),
        (MODIFIED + ROW + "[[coupling]]\njoint='J1'\nfollows='J1'\nfactor=1\n", "follows itself"),
        (MODIFIED + ROW + ROW + "[[coupling]]\njoint='J2'\nfollows='J1'\n", "factor is missing"),
        ("units = 'mm'\n" + MODIFIED + ROW, "unknown key units"),
        (MODIFIED + "[[joint]]\na_mm = 1e300\n", r"1e\+297 m; expected at most 1000 m"),
        (MODIFIED + "[[joint]]\nalpha_deg = 1e300\n", "rad; expected at most 1000 rad"),
        (MODIFIED + "[[joint]]\nlower_deg = -1e300\nupper_deg = 9\n", "rad; expected at most 1000 rad"),
        (MODIFIED + ROW + "[tool]\nxyz_m = [5000, 0, 0]\n", "5000 m; expected at most 1000 m"),
        (MODIFIED + "gravity_m_s2 = [0, 0, -9810]\n" + ROW, r"-9810 m/s\*\*2; expected at most 100 m/s\*\*2"),
        (MODIFIED + 65 * ROW, r"65 \[\[joint\]\] rows; expected at most 64"),
        (MODIFIED + 2 * ROW + 2 * COUPLING, "J2 follows J1 already"),
        (MODIFIED + 2 * ROW + COUPLING + COUPLING.translate({49: "2", 50: "1"}), "expected couplings without a cycle"),
        (MODIFIED + 2 * ROW + COUPLING.replace("factor=1", "factor=1e300"), r"factor: 1e\+300"),
        ('note = "a\\u001b[2J"\n' + MODIFIED + ROW, r"control characters in 'a\\x1b\[2J'"),
        ('name = "a\\nb"\n' + MODIFIED + ROW, r"control characters in 'a\\nb'"),
        (MODIFIED + "[[joint]]\nname = 'x'\n", "joint 'x' has the name of another column"),
        (MODIFIED + "[[joint]]\nname = 'lambda'\n", "'lambda', expected letters"),
        (MODIFIED + f"[[joint]]\nname = '{'a' * 201}'\n", "has 201 characters; expected at most 200"),
    ],
)
def test_bad_file_is_one_line(content: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=complaint) as caught:
        MechanismChoice(str(written(content, tmp_path))).load()
    assert "\n" not in str(caught.value)
    assert "arm.toml" in str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        read_dh(tmp_path / "none.toml")


@pytest.mark.parametrize("name", ["../../x", "<b>", "a b", '"""', "1J"])
def test_a_joint_is_named_as_expressions_can_write_it(name: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(f"convention = 'standard'\n[[joint]]\nname = '{name}'\na_mm = 100\n")
    with pytest.raises(InputError, match="expected letters, digits and underscores"):
        read_dh(path)


@pytest.mark.parametrize("text", ["a = " + 100_000 * "[", "a = " + 5000 * "{a = "])
def test_a_table_nested_too_deep_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(text)
    with pytest.raises(InputError, match="nested too deep"):
        MechanismChoice(str(path)).load()


ARMS_DH = """
convention = "standard"
[[arm]]
name = "left"
[arm.tool]
xyz_mm = [0, 0, 100]
[[arm.joint]]
name = "torso"
d_mm = 900
alpha_deg = -15
[[arm.joint]]
name = "left_1"
a_mm = 400
d_mm = 200
[[arm]]
name = "right"
[[arm.joint]]
name = "torso"
d_mm = 900
alpha_deg = 15
[[arm.joint]]
name = "right_1"
a_mm = 500
d_mm = -200
"""


def test_arms_that_share_a_joint_are_rows_of_one_name(tmp_path: Path) -> None:
    arms = load_mechanism(str(written(ARMS_DH, tmp_path)))
    assert [joint.name for joint in arms.joints] == ["torso", "left_1", "right_1"]
    q = np.array([[0.3, -0.5, 0.8]])
    frames = se3.chain(arms.transforms(q))
    for tip, side, column, a, d, z in (("left", -15, 1, 0.4, 0.2, 0.1), ("right", 15, 2, 0.5, -0.2, 0.0)):
        end = shift(2, 0.9) @ turn(2, q[0, 0]) @ turn(0, np.radians(side)) @ turn(2, q[0, column])
        end = end @ shift(2, d) @ shift(0, a) @ shift(2, z)
        np.testing.assert_allclose(frames[arms.slots.index(arms.tips[tip])][0], end, atol=1e-12)
    alone = load_mechanism(str(written(ARMS_DH, tmp_path)), frame="right")
    assert [joint.name for joint in alone.joints] == ["torso", "right_1"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "d_mm = 900\nalpha_deg = 15",
            "d_mm = 800",
            "joint 'torso' of arm 'right' differs from the joint of this name",
        ),
        ('name = "right"', 'name = "left"', "arms 'left', 'left'; expected different names"),
        ('[[arm]]\nname = "right"', "[[arm]]", "name is '', expected a text"),
        ('convention = "standard"', 'convention = "standard"\n[tool]', "unknown key tool"),
    ],
)
def test_arms_that_cannot_be_are_one_line(old: str, new: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        load_mechanism(str(written(ARMS_DH.replace(old, new), tmp_path)))
    with pytest.raises(InputError, match="no measured frame named 'third'; expected one of 'left', 'right'"):
        load_mechanism(str(written(ARMS_DH, tmp_path)), frame="left,third")


@pytest.fixture
def rows() -> Path:
    return Path(str(files("robots.data") / "irb6400r.toml"))


def test_agrees_with_its_modified_dh_rows_to_rounding(rows: Path) -> None:
    coded, table = irb6400r(), read_dh(rows)
    q = poses(coded, np.random.default_rng(3), 200)
    flange, last_row = slot_frames(coded, q)[-1], slot_frames(table, q)[-1]
    np.testing.assert_allclose(flange[:, :3, 3], last_row[:, :3, 3], rtol=0, atol=4e-15)
    turn = last_row[0, :3, :3].T @ flange[0, :3, :3]
    np.testing.assert_allclose(last_row[:, :3, :3] @ turn, flange[:, :3, :3], atol=4e-15)


def test_both_descriptions_weigh_the_same(rows: Path) -> None:
    coded, table = irb6400r(), read_dh(rows)
    q = poses(coded, np.random.default_rng(4), 20)
    coded_loads, table_loads = (arm.loads(q, np.full(20, 60.0)) for arm in (coded, table))
    for name in (*(f"torque_{joint.name}" for joint in coded.joints), "moment_base_x", "moment_base_y"):
        np.testing.assert_allclose(coded_loads[name], table_loads[name], atol=1e-8)
    for joint, row in zip(coded.joints, table.joints, strict=True):
        assert (joint.name, joint.lower, joint.upper) == (row.name, row.lower, row.upper)


@pytest.mark.parametrize(
    ("name", "reach"), [("irb6400r", 0.240 + 1.175 + 0.200), ("irb6400r-2.8", 0.240 + 1.520 + 0.200)]
)
def test_stands_upright_at_zero(name: str, reach: float) -> None:
    flange = slot_frames(irb6400r(name), np.zeros((1, 6)))[-1, 0]
    np.testing.assert_allclose(flange[:3, 3], [reach, 0.0, 0.800 + 1.050 + 0.225], atol=1e-15)
    np.testing.assert_array_equal(flange[:3, :3], np.eye(3))


def test_parallel_bar_keeps_the_upper_arm_at_its_angle_to_the_ground() -> None:
    arm = irb6400r()
    q = np.array([[0.3, angle, 0.4, 0.1, 0.2, 0.5] for angle in (-0.5, 0.0, 0.9)])
    orientations = slot_frames(arm, q)[-1, :, :3, :3]
    np.testing.assert_allclose(orientations, np.broadcast_to(orientations[0], orientations.shape), atol=1e-15)
    assert arm.joints[1].drive == (("J2.moving", "Ry", 1.0), ("J3.moving", "Ry", -1.0))
    assert arm.joints[2].drive == (("J3.moving", "Ry", 1.0),)


def test_the_motor_of_axis_two_does_not_carry_the_upper_arms_moment() -> None:
    loads = irb6400r().loads(np.array([[0.0, 0.6, 0.3, 0.0, 0.4, 0.0]]), np.array([150.0]))
    np.testing.assert_allclose(loads["torque_J2"], loads["moment_J2_y"] - loads["moment_J3_y"], rtol=1e-14)
    beyond = 149.3 + 10.2 + 17.7 + 41.5 + 150.0
    lever = np.sin(0.6) * (156.2 * 0.525 + beyond * 1.050)
    np.testing.assert_allclose(loads["torque_J2"], 9.81 * lever, rtol=1e-12)
