"""Values that no machine and no instrument gives are refused or warned of before any fit."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import numbers, one_line, robot, run, table, write

import gpmodel as gp
from gpmodel.checks.judge import MOST_FITTED, check_dataset, evenly
from gpmodel.errors import QUOTED
from gpmodel.table.bundles import _same_joints

GOOD = table(60)
ARM = """<robot name="two"><link name="l0"/><link name="l1"/><link name="l2"/>
<joint name="first" type="revolute"><parent link="l0"/><child link="l1"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="second" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.5 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint></robot>"""


def warned(frame: pd.DataFrame) -> str:
    return " ".join(f.text for f in gp.check("irb6400r", frame).findings if f.severity == "warning")


def noisy() -> pd.DataFrame:
    rng = np.random.default_rng(0)
    return GOOD.assign(**{"x [mm]": numbers(GOOD, "x [mm]") + rng.normal(0, 50, len(GOOD))})


WARNED: dict[str, tuple[Callable[[], pd.DataFrame], str]] = {
    "a column of noise": (
        noisy,
        r"the standard model leaves \d+(\.\d+)? mm RMS; calibrated machines",
    ),
    "no z": (lambda: GOOD.drop(columns="z [mm]"), "z is not measured in any row"),
    "too few once some are held out": (lambda: GOOD.iloc[:12], "with 30 % of the poses held out too few are left"),
}


@pytest.mark.long
@pytest.mark.parametrize("case", WARNED)
def test_what_can_be_fitted_but_proves_little_is_warned_of(case: str) -> None:
    make, said = WARNED[case]
    assert not re.search(said, warned(GOOD))
    assert re.search(said, warned(make()))


def test_what_check_warns_of_calibrate_refuses() -> None:
    with pytest.raises(gp.InputError, match="measured values for"):
        gp.calibrate("irb6400r", GOOD.iloc[:12])


REFUSED = {
    "negative distance": ({"distance_a [mm]": "-5"}, "column 'distance_a', row 1: -5 mm; expected a distance of zero"),
    "one distance everywhere": ({"distance_a [mm]": "5"}, "expected distances of the tool point from one fixed point"),
    "below absolute zero": ({"temperature [degC]": "-400"}, "row 1: -400 degC is below absolute zero, -273.15 degC"),
    "a length of no bar": ({"length [mm]": "5"}, "row 1: a length without a pair; expected a column 'pair'"),
    "no kelvin": ({"temperature [K]": "-1"}, "below absolute zero"),
}


@pytest.mark.long
def test_touches_of_one_plane_that_the_points_are_not_on_are_refused(tmp_path: Path) -> None:
    path = write(GOOD.assign(on_plane="P"), tmp_path / "t.csv")
    for command in ("check", "calibrate"):
        said = one_line(run(command, path, "--mechanism", "irb6400r"), 2)
        assert "column 'on_plane': does not fit irb6400r" in said
        assert said.endswith("expected what the tool point touched in these poses")


@pytest.mark.long
@pytest.mark.parametrize("case", REFUSED)
def test_what_nothing_measures_is_refused(case: str) -> None:
    column, said = REFUSED[case]
    with pytest.raises(gp.InputError, match=re.escape(said)):
        gp.check("irb6400r", GOOD.assign(**column)).refuse()


MECHANISMS = {
    "floating": (ARM.replace('"second" type="revolute"', '"second" type="floating"'), "joint 'second' is floating"),
    "planar": (ARM.replace('"second" type="revolute"', '"second" type="planar"'), "joint 'second' is planar"),
    "mimic of nobody": (
        ARM.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="nope"/>'),
        "joint 'second' mimics 'nope', which is no moving joint of the file; expected one of first, second",
    ),
    "an arm of 1e200 m": (ARM.replace("0.5 0 0", "0 0 1e200"), "1e+200 m; expected at most 1000 m"),
    "a frame turned by 1e300": (ARM.replace('"0.5 0 0"', '"0.5 0 0" rpy="1e300 0 0"'), "1e+300 rad; expected at most"),
    "two parents": (
        ARM.replace("</robot>", '<joint name="c" type="fixed"><parent link="l0"/><child link="l2"/></joint></robot>'),
        "'l2' hangs on two joints",
    ),
    "two roots": (ARM.replace("</robot>", '<link name="l9"/></robot>'), "l0, l9 without a parent; expected one"),
}


@pytest.mark.parametrize("case", MECHANISMS)
def test_joints_and_lengths_of_no_machine_are_refused(case: str, tmp_path: Path) -> None:
    text, said = MECHANISMS[case]
    (tmp_path / "arm.urdf").write_text(text)
    assert said in one_line(run("poses", "--mechanism", tmp_path / "arm.urdf", "-n", 3), 2)


ROWS = {
    "a_mm = 1e300": "1e+297 m; expected at most 1000 m",
    "alpha_deg = 1e300": "rad; expected at most 1000 rad",
    "lower_deg = -1e300\nupper_deg = 9": "rad; expected at most 1000 rad",
    "a_mm = 5\n[tool]\nxyz_m = [5000, 0, 0]": "5000 m; expected at most 1000 m",
}


@pytest.mark.parametrize("row", ROWS)
def test_denavit_hartenberg_rows_of_no_machine_are_refused(row: str, tmp_path: Path) -> None:
    (tmp_path / "arm.toml").write_text(f"convention = 'standard'\n[[joint]]\na_mm = 100\n[[joint]]\n{row}\n")
    assert ROWS[row] in one_line(run("poses", "--mechanism", tmp_path / "arm.toml", "-n", 3), 2)


def test_gravity_in_millimetres_is_refused(tmp_path: Path) -> None:
    rows = "[[joint]]\na_mm = 100\n" * 2
    (tmp_path / "arm.toml").write_text(f"convention = 'standard'\ngravity_m_s2 = [0, 0, -9810]\n{rows}")
    said = one_line(run("poses", "--mechanism", tmp_path / "arm.toml", "-n", 3), 2)
    assert "-9810 m/s**2; expected at most 100 m/s**2" in said


OPTIONS = {
    ("check", "t.csv", "--mechanism", "irb6400r", "--out", ""): "'--out': '' is no path",
    ("check", "t.csv", "--mechanism", "irb6400r", "--cameras", "c.toml"): "--cameras: t.csv has no column u or v",
    (
        "check",
        "t.csv",
        "--mechanism",
        "irb6400r",
        "--payload-com",
        "0,0,9mm",
    ): "--payload-com: nothing is carried in",
    ("simulate", "--mechanism", "ur5", "--out", "t.xlsx"): "--out: t.xlsx: a table is written as .csv; expected such",
    ("simulate", "--mechanism", "ur5", "--out", "t.png"): "--out: t.png: a table is written as .csv; expected such",
    ("poses", "--mechanism", "ur5", "--above=-5km"): "--above: -5km, expected at most 1000 m, the unit may be wrong",
    ("poses", "--after", "R", "--mechanism", "panda"): "--mechanism: is that of the model in R",
    ("check", "t.csv", "--mechanism", "ur5", "--payload-com", "a,b,c"): "'a' is no number",
    ("calibrate", "t.csv", "--mechanism", "irb6400r", "--holdout", 0.001): "of 60 poses holds out 1, which prove",
    ("calibrate", "t.csv", "--mechanism", "irb6400r", "--effect", "base_compliance=1e-6"): "'=VALUE' is simulate's",
}


@pytest.mark.parametrize("arguments", OPTIONS, ids=str)
def test_options_that_would_be_ignored_or_prove_nothing_are_refused(
    arguments: tuple[object, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(GOOD, tmp_path / "t.csv")
    (tmp_path / "c.toml").write_text("[camera.C]\nlink = 'tool'\n")
    assert OPTIONS[arguments] in run(*arguments).stderr.splitlines()[-1]
    assert run(*arguments).exit_code == 2


def test_a_long_text_is_quoted_in_part(tmp_path: Path) -> None:
    path = write(GOOD, tmp_path / "t.csv")
    said = run("calibrate", path, "--mechanism", "irb6400r", "--quiet", "--effect", "y" * 5000).stderr
    assert "y" * QUOTED in said
    assert "y" * (QUOTED + 1) not in said


def test_a_comment_on_top_is_called_no_header(tmp_path: Path) -> None:
    path = write(GOOD, tmp_path / "t.csv")
    path.write_text(f"# measured on Monday\n{path.read_text()}")
    assert "line 1: '# measured on Monday' is no header" in one_line(run("check", path, "--mechanism", "irb6400r"), 2)


def test_of_many_rows_a_part_is_judged_and_that_is_said() -> None:
    arm, made = robot(MOST_FITTED + 500, 3)
    said = check_dataset(arm, made.dataset)
    assert f"judged on {MOST_FITTED} of {MOST_FITTED + 500} rows, in even stretches" in [f.text for f in said]
    rows = evenly(200_000)
    assert len(rows) == MOST_FITTED
    assert (rows[0], rows[-1]) == (0, 199_999)
    assert np.mean(np.diff(rows) == 1) > 0.9


def test_a_row_beyond_its_limits_is_found_among_many() -> None:
    arm, made = robot(MOST_FITTED + 500, 3)
    q = made.dataset.q.copy()
    q[77, 2] = 100.0
    assert any("row 78" in f.text for f in check_dataset(arm, replace(made.dataset, q=q)) if f.severity == "error")


def test_equal_rows_are_one_pose_as_the_first_of_them_says() -> None:
    rng = np.random.default_rng(0)
    for spread in (1e-4, 5e-4, 2e-3):
        q = (rng.normal(size=(30, 3)) * spread)[rng.integers(0, 30, 80)]
        expected = np.full(80, -1)
        for row in range(80):
            if expected[row] < 0:
                near = (np.abs(q - q[row]).max(axis=1) <= 5e-4) & (expected < 0)
                expected[near] = row
        assert np.array_equal(_same_joints(q), expected)
