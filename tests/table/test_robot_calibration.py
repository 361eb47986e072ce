"""Offsets of robot_calibration become the URDF that they belong to."""

from pathlib import Path

import numpy as np
import pytest
from cli_cases import one_line, run

import gpmodel as gp

SLIDE_AND_TURN = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 0 2"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.1 0 0" rpy="0 0 0.5"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_offsets_of_joints_are_what_their_readings_lack(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(SLIDE_AND_TURN)
    (tmp_path / "found.yaml").write_text("slide: 0.01\nturn: 0.2\nturn_x: 0.003\nhead_camera_fx: 0.02\n")
    options = ("--nominal", tmp_path / "r.urdf", "--out", tmp_path / "c.urdf")
    done = run("import", tmp_path / "found.yaml", *options)
    assert (done.exit_code, done.stderr) == (0, "left out, no joint of r.urdf: head_camera_fx\n")
    before, after = (gp.load_mechanism(str(tmp_path / name)) for name in ("r.urdf", "c.urdf"))
    q, more = np.array([[0.1, 0.3]]), np.array([[0.11, 0.5]])
    ends = [np.linalg.multi_dot([*arm.transforms(v)[:, 0]]) for arm, v in ((before, more), (after, q))]
    shift = ends[1][:3, 3] - ends[0][:3, 3]
    np.testing.assert_allclose(shift, 0.003 * np.array([np.cos(0.5), np.sin(0.5), 0.0]), atol=1e-12)
    np.testing.assert_allclose(ends[1][:3, :3], ends[0][:3, :3], atol=1e-12)
    assert "left out, no joint of r.urdf: head_camera_fx" in (tmp_path / "c.urdf").read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("elbow: 0.1\n", "found.yaml: no offset of a joint of r.urdf; it has elbow"),
        ("slide 0.1\n", "found.yaml, line 1: 'slide 0.1'; expected robot_calibration's offsets, a line `NAME: number`"),
        ("slide: nan\n", "found.yaml, line 1: 'slide: nan'; expected"),
    ],
)
def test_offsets_that_cannot_be_are_one_line(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "r.urdf").write_text(SLIDE_AND_TURN)
    (tmp_path / "found.yaml").write_text(text)
    assert said in one_line(run("import", tmp_path / "found.yaml", "--nominal", tmp_path / "r.urdf"), 2)
