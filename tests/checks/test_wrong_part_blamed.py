"""Messages about a file name its wrong part."""

from pathlib import Path

import pytest

import gpmodel as gp
from gpmodel.checks.notes import not_read
from gpmodel.errors import InputError
from gpmodel.table.cells import read_frame
from gpmodel.table.read import dataset_from
from robots.urdf import read_urdf

ARM = (
    '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
    '<child link="b"/><axis xyz="0 0 1"/><limit lower="-2" upper="2"/></joint></robot>'
)
HEADER = "J1 [deg],x [mm],y [mm],z [mm]"


def urdf(tmp_path: Path, old: str = "", new: str = "") -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"-2" upper="2"', '"-150" upper="150"', "joint 'j': limits -150 to 150 rad look like degrees; expected rad"),
        ("joint", "Joint", "<Joint> is no element of a URDF; expected <joint>"),
        ("<axis", "<Axis", "<Axis> is no element of a URDF; expected <axis>"),
    ],
)
def test_a_urdf_in_degrees_or_capitals_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        read_urdf(urdf(tmp_path, old, new))


def test_limits_that_say_there_are_none_stay_allowed(tmp_path: Path) -> None:
    limits = read_urdf(urdf(tmp_path, '"-2" upper="2"', '"-1e6" upper="12"')).limits.tolist()
    assert limits == [[-float("inf"), 12.0]]


def test_an_axis_that_is_not_given_is_said(tmp_path: Path) -> None:
    arm = read_urdf(urdf(tmp_path, '<axis xyz="0 0 1"/>', ""))
    (tmp_path / "t.csv").write_text(f"{HEADER}\n1,2,3,4\n2,3,4,5\n")
    data = gp.read_table(tmp_path / "t.csv", arm)
    assert "axis of joint j, which the file does not give; 1 0 0 is taken" in " ".join(not_read(arm, data))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (
            f"Instrument: X\nDate: 2024\n\n{HEADER}\n1,2,3,4\n",
            "line 1: 'Instrument: X' is no header; .*line 4 has them",
        ),
        (f"# Monday\n{HEADER}\n1,2,3,4\n", "line 1: '# Monday' is no header; .*line 2 has them"),
        (HEADER.replace("[", "(").replace("]", ")") + "\n1,2,3,4\n", r"'J1 \(deg\)', 'x \(mm\)', .*write 'J1 \[deg\]'"),
    ],
)
def test_a_header_below_others_or_in_parentheses(tmp_path: Path, content: str, said: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(content)
    with pytest.raises(InputError, match=said):
        dataset_from(read_frame(path)[0], path, read_urdf(urdf(tmp_path)))


def test_a_column_of_no_known_unit_is_left_out_and_said(tmp_path: Path) -> None:
    arm = read_urdf(urdf(tmp_path))
    rows = [f"{0.01 * i},{i},{i * i % 7},{i * i % 5},1013" for i in range(12)]
    (tmp_path / "t.csv").write_text("\n".join([f"{HEADER},Pressure [mBar]", *rows]))
    data = gp.read_table(tmp_path / "t.csv", arm)
    assert (data.ignored, data.extras) == (("Pressure [mBar]",), {})
