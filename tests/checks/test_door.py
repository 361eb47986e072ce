"""Test the tables that are refused before a fit, and the named cause."""

import re
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import numbers, one_line, robot, run, table, write
from instances import some

import gpmodel as gp
from gpmodel.application.compensate import beyond_limits
from gpmodel.checks.judge import MOST_FITTED, check_dataset, evenly, refuse
from gpmodel.checks.notes import not_read
from gpmodel.errors import QUOTED, InputError
from gpmodel.mechanism.branches import random_poses
from gpmodel.mechanism.source import load_mechanism
from gpmodel.model.error_model import prepare
from gpmodel.numerics.se3 import chain
from gpmodel.planning.simulate import simulate
from gpmodel.table.blocks import _same_joints
from gpmodel.table.cells import read_frame
from gpmodel.table.read import dataset_from
from robots.urdf import read_urdf

GOOD = table(60)


def warned(frame: pd.DataFrame) -> str:
    return " ".join(f.text for f in gp.check("irb6400r", frame).findings if f.severity == "warning")


def noisy() -> pd.DataFrame:
    rng = np.random.default_rng(0)
    return GOOD.assign(**{"x [mm]": numbers(GOOD, "x [mm]") + rng.normal(0, 50, len(GOOD))})


WARNED: dict[str, tuple[Callable[[], pd.DataFrame], str]] = {
    "a column of noise": (
        noisy,
        r"residual of the standard model: \d+(\.\d+)? mm RMS; calibrated machines",
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
        assert said.endswith("expected touches of the tool point at these poses")


@pytest.mark.long
@pytest.mark.parametrize("case", REFUSED)
def test_what_nothing_measures_is_refused(case: str) -> None:
    column, said = REFUSED[case]
    with pytest.raises(gp.InputError, match=re.escape(said)):
        gp.check("irb6400r", GOOD.assign(**column)).refuse()


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
    ): "--payload-com: t.csv has no payload",
    ("simulate", "--mechanism", "ur5", "--out", "t.xlsx"): "--out: t.xlsx: a table is written as .csv; expected such",
    ("simulate", "--mechanism", "ur5", "--out", "t.png"): "--out: t.png: a table is written as .csv; expected such",
    ("poses", "--mechanism", "ur5", "--above=-5km"): "--above: -5km, expected at most 1000 m, the unit may be wrong",
    ("poses", "--after", "R", "--mechanism", "panda"): "--mechanism: is already given by the model in R",
    ("check", "t.csv", "--mechanism", "ur5", "--payload-com", "a,b,c"): "'a' is no number",
    ("calibrate", "t.csv", "--mechanism", "irb6400r", "--holdout", 0.001): "of 60 poses holds out 1, too few",
    ("calibrate", "t.csv", "--mechanism", "irb6400r", "--effect", "base_compliance=1e-6"): "'=VALUE' is for simulate",
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


@pytest.mark.long
def test_of_many_rows_a_part_is_judged_and_that_is_said() -> None:
    arm, made = robot(MOST_FITTED + 500, 3)
    said = check_dataset(arm, made.dataset)
    assert f"tested on {MOST_FITTED} of {MOST_FITTED + 500} rows, in equally spaced blocks" in [f.text for f in said]
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


ARM_BLAMED = (
    '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
    '<child link="b"/><axis xyz="0 0 1"/><limit lower="-2" upper="2"/></joint></robot>'
)
HEADER = "J1 [deg],x [mm],y [mm],z [mm]"


def urdf(tmp_path: Path, old: str = "", new: str = "") -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM_BLAMED.replace(old, new))
    return path


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


GOOD_ROWS = table(90)
POINTS = ["x [mm]", "y [mm]", "z [mm]"]


def placed(rows: list[int], points: np.ndarray) -> pd.DataFrame:
    """The good table with other points in some rows."""
    out = GOOD_ROWS.astype(dict.fromkeys(POINTS, float))
    out.loc[rows, POINTS] = points
    return out


def shuffled() -> pd.DataFrame:
    rows = list(range(5, 85, 8))
    return placed(rows, numbers(GOOD_ROWS, POINTS)[np.roll(rows, 1)])


FEW: dict[str, tuple[Callable[[], pd.DataFrame], str]] = {
    "one digit": (lambda: placed([17], numbers(GOOD_ROWS, POINTS)[17] + [20.0, 0.0, 0.0]),
                  "1 of 90 readings left out (row 18)"),
    "a lost beam": (lambda: placed([30, 31], np.zeros((2, 3))), "2 of 90 readings left out (rows 31, 32)"),
    "-999.9": (lambda: placed([60], np.full((1, 3), -999.9)), "1 of 90 readings left out (row 61)"),
    "ten rows shuffled": (shuffled, "10 of 90 readings left out (rows 6, 14, 22"),
}  # fmt: skip


@pytest.mark.parametrize("case", some(FEW, "one digit", "ten rows shuffled"))
def test_a_few_bad_readings_are_named_and_the_table_stays_fit(case: str) -> None:
    make, said = FEW[case]
    judged = gp.check("irb6400r", make())
    assert not judged.unfit, judged.summary()
    assert said in " ".join(judged.summary().split())


@pytest.mark.parametrize("case", ["one digit", pytest.param("ten rows shuffled", marks=pytest.mark.long)])
def test_a_few_bad_readings_are_left_out_of_every_error(case: str) -> None:
    make, said = FEW[case]
    result = gp.calibrate("irb6400r", make())
    assert said in result.verdict
    ladder = result.record.ladder
    for errors in (ladder[-1].train, ladder[-1].heldout):
        assert (errors.max_mm or np.inf) < 0.3


@pytest.mark.long
@pytest.mark.parametrize("share", [0.45, *(pytest.param(s, marks=pytest.mark.long) for s in (0.3, 0.6))])
def test_readings_of_which_many_are_bad_are_refused(share: float, tmp_path: Path) -> None:
    rng = np.random.default_rng(int(100 * share))
    rows = rng.choice(90, int(share * 90), replace=False).tolist()
    off = rng.normal(0.0, 100.0, (len(rows), 3))
    path = write(placed(rows, numbers(GOOD_ROWS, POINTS)[rows] + off), tmp_path / "bad.csv")
    for command in ("check", "calibrate"):
        said = one_line(run(command, path, "--mechanism", "irb6400r"), 2)
        assert "of 90 measurements have errors up to" in said


def test_check_ends_with_2_where_a_table_is_not_fit_to_calibrate_with(tmp_path: Path) -> None:
    noisy = GOOD_ROWS.assign(**{"x [mm]": numbers(GOOD_ROWS, "x [mm]") + np.random.default_rng(0).normal(0, 9, 90)})
    result = run("check", write(noisy, tmp_path / "t.csv"), "--mechanism", "irb6400r")
    assert result.exit_code == 2
    assert "not fit to calibrate with" in result.stdout


@pytest.mark.first(2)
@pytest.mark.parametrize(("radius", "fits"), [(0.15, True), (0.3, True), (0.6, True), (0.3, False)])
def test_a_ball_bar_of_nearly_constant_length_is_accepted(radius: float, fits: bool) -> None:
    """The nominal points are on a sphere, so that the spread of the lengths is the error of the machine itself.

    The same lengths at other poses are refused.
    """
    rng, point = np.random.default_rng(5), np.array([0.05, 0.02, 0.3])
    arm = load_mechanism("irb6400r")

    def place(q: np.ndarray) -> np.ndarray:
        return np.asarray((chain(arm.transforms(q))[-1] @ np.append(point, 1.0))[:, :3])

    home = random_poses(arm, 1, rng)
    q = random_poses(arm, 400, rng)
    for _ in range(60 if fits else 0):
        off = np.linalg.norm(place(q) - place(home), axis=1) - radius
        slope = np.stack(
            [np.linalg.norm(place(q + h) - place(home), axis=1) - radius - off for h in 1e-6 * np.eye(6)], 1
        )
        step = 1e-6 * slope * (off / np.sum(slope**2, axis=1))[:, None]
        q = q - np.clip(step, -0.1, 0.1)
    kept = ~beyond_limits(arm, q) & (np.abs(np.linalg.norm(place(q) - place(home), axis=1) - radius) < 1e-6)
    q = q[kept if fits else slice(None)][:60]
    made = simulate(arm, q, (), rng, noise=3e-6, geometry_sigma=3e-4, tool_point=point)
    turn = made.placement.registration[""]
    lengths = np.linalg.norm(made.dataset.position - (turn[:3, :3] @ place(home)[0] + turn[:3, 3]), axis=1)
    read = lengths if fits else rng.normal(radius, 1e-3, 60)
    bar = replace(made.dataset, position=np.full((60, 3), np.nan), distances={"distance_a": read})
    with nullcontext() if fits else pytest.raises(InputError, match="distances of the tool point from one fixed point"):
        refuse(arm, prepare(arm, bar), ())
