"""Test that bad tables and bad options end in one line."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import numbers, one_line, run, table, write

import gpmodel as gp

GOOD = table()
JOINTS = [f"J{i} [deg]" for i in range(1, 7)]
LENGTHS = ["x [mm]", "y [mm]", "z [mm]"]


def renamed(**names: str) -> Callable[[], pd.DataFrame]:
    return lambda: GOOD.rename(columns={k.replace("_", " [") + "]": v for k, v in names.items()})


def cell(column: str, row: int, value: str) -> Callable[[], pd.DataFrame]:
    def make() -> pd.DataFrame:
        frame = GOOD.copy()
        frame.loc[row, column] = value
        return frame

    return make


def scaled(columns: list[str], factor: float) -> Callable[[], pd.DataFrame]:
    return lambda: GOOD.assign(**{c: numbers(GOOD, c) * factor for c in columns})


def alike() -> pd.DataFrame:
    return GOOD.assign(**{c: GOOD[c].iloc[0] for c in JOINTS})


def swapped() -> pd.DataFrame:
    return GOOD.assign(**{"x [mm]": GOOD["y [mm]"], "y [mm]": GOOD["x [mm]"]})


def repeated() -> pd.DataFrame:
    return pd.concat([GOOD.iloc[:5]] * 20, ignore_index=True)


TABLES: dict[str, tuple[Callable[[], pd.DataFrame], tuple[str, ...]]] = {
    "no unit on a joint": (renamed(J2_deg="J2"), ("column 'J2'", "no unit", "J2 [deg]")),
    "no unit on a length": (renamed(y_mm="y"), ("column 'y'", "no unit", "y [mm]")),
    "no unit on an input": (lambda: GOOD.assign(temperature="20"), ("column 'temperature'", "no unit")),
    "unknown unit": (renamed(J3_deg="J3 [grads per day]"), ("column 'J3'", "grads per day", "[deg] or [rad]")),
    "unknown unit of a torque": (lambda: GOOD.assign(**{"tau_2 [blorp]": "1"}), ("column 'tau_2'", "[blorp]", "[N*m]")),
    "all of a header at once": (
        lambda: GOOD.rename(columns={"x [mm]": "X", "y [mm]": "y", "J2 [deg]": "J2"}).assign(Z="1", Q0="0.1"),
        (
            "columns 'X', 'Z': reserved names in lower case; expected 'x', 'z'",
            "columns 'J2', 'y', 'Q0': no unit; write 'J2 [deg]', 'y [mm]', 'Q0",
        ),
    ),
    "length unit on a joint": (renamed(J1_deg="J1 [mm]"), ("column 'J1'", "no unit of angle")),
    "joint missing": (lambda: GOOD.drop(columns="J4 [deg]"), ("'J4' is missing", "J1, J2")),
    "joint extra": (lambda: GOOD.assign(**{"J7 [deg]": "0"}), ("'J7' is one too many", "J6")),
    "x in capitals": (renamed(x_mm="X [mm]"), ("column 'X'", "column 'X': reserved names in lower case; expected 'x'")),
    "a payload in capitals": (lambda: GOOD.assign(**{"Payload [kg]": "9"}), ("column 'Payload'", "expected 'payload'")),
    "groups in capitals": (lambda: GOOD.assign(Group="a"), ("column 'Group'", "expected 'group'")),
    "torque in a unit of mass": (lambda: GOOD.assign(**{"torque_J2 [kg]": "9"}), ("column 'torque_J2' [kg]", "[N*m]")),
    "repeats that are none": (
        lambda: GOOD.assign(repeat=[str(i // 2) for i in range(len(GOOD))]),
        ("repeat label '", "expected another label for another pose"),
    ),
    "one pose at two places": (
        lambda: GOOD.assign(**{c: [GOOD[c].iloc[0], *GOOD[c].iloc[:-1]] for c in JOINTS}),
        ("rows 1 and 2 are one pose", "mm apart"),
    ),
    "too large to be measured": (cell("x [mm]", 2, "1e300"), ("column 'x'", "row 3", "1e+300")),
    "text in numbers": (
        cell("z [mm]", 6, "n/a"),
        ("column 'z'", "row 7", "'n/a' is no number", "or try gpmodel import"),
    ),
    "thousands": (cell("z [mm]", 6, "2.317,286"), ("row 7", "'2.317,286' is no number", "or try gpmodel import")),
    "a line break in a cell": (cell("z [mm]", 6, "n/a\n1"), ("row 7", "'n/a 1' is no number")),
    "text in a joint": (cell("J5 [deg]", 0, "abc"), ("column 'J5'", "row 1", "'abc' is no number")),
    "NaN in a joint": (cell("J5 [deg]", 2, "NaN"), ("column 'J5'", "row 3")),
    "NaN in a length": (cell("x [mm]", 2, "nan"), ("column 'x'", "row 3", "'nan' is no number")),
    "infinite": (cell("x [mm]", 2, "inf"), ("column 'x'", "row 3", "infinite")),
    "empty joint": (cell("J1 [deg]", 4, ""), ("column 'J1'", "row 5", "empty")),
    "nothing measured": (lambda: GOOD[JOINTS], ("nothing measured", "x [mm]")),
    "no rows": (lambda: GOOD.iloc[:0], ("no rows",)),
    "one pose": (lambda: GOOD.iloc[:1], ("only one pose",)),
    "fewer poses than unknowns": (lambda: GOOD.iloc[:8], ("8 distinct poses give 24 measured values for 27 unknowns",)),
    "few poses repeated often": (repeated, ("5 distinct poses", "27 unknowns")),
    "all poses alike": (alike, ("all 40 poses are equal",)),
    "beyond the limits": (cell("J2 [deg]", 3, "86"), ("column 'J2'", "row 4", "86 deg", "-70 deg to 85 deg")),
    "degrees given as radians": (
        lambda: GOOD.rename(columns={c: c.replace("deg", "rad") for c in JOINTS}),
        ("radians", "look like degrees", "write [deg]"),
    ),
    "radians given as degrees": (scaled(JOINTS, np.pi / 180), ("degrees", "look like radians", "write [rad]")),
    "one joint in the other unit": (scaled(["J4 [deg]"], np.pi / 180), ("column 'J4' looks like [rad]",)),
    "joint with the wrong sign": (scaled(["J2 [deg]"], -1.0), ("column 'J2' probably has the opposite sign",)),
    "x and y swapped": (swapped, ("look swapped",)),
    "z mirrored": (scaled(["z [mm]"], -1.0), ("wrong sign",)),
    "metres given as millimetres": (
        scaled(LENGTHS, 1e-3),
        ("x, y and z look 1000 times too small", "[m] given as [mm]"),
    ),
    "inches given as millimetres": (scaled(LENGTHS, 1 / 25.4), ("25.4 times too small", "[in] given as [mm]")),
    "distances of something else": (
        lambda: GOOD[JOINTS].assign(**{"distance_A [mm]": [str(1000 + 7 * i) for i in range(len(GOOD))]}),
        ("column 'distance_A'", "does not fit", "one fixed point"),
    ),
    "another robot's table": (
        lambda: table(name="irb6400r-2.8").assign(**{c: GOOD[c] for c in JOINTS}),
        ("do not fit irb6400r", "right mechanism"),
    ),
    "one length in another unit": (scaled(["y [mm]"], 1e-3), ("column 'y' looks 1000 times too small",)),
}


@pytest.mark.long
@pytest.mark.parametrize("command", ["check", "calibrate"])
@pytest.mark.parametrize("case", TABLES)
def test_bad_table_is_refused_in_one_line(case: str, command: str, tmp_path: Path) -> None:
    make, said = TABLES[case]
    out = tmp_path / "results"
    path = write(make(), tmp_path / "measured.csv")
    line = one_line(run(command, path, "--mechanism", "irb6400r", "--out", out), 2)
    assert line.startswith("gpmodel: ")
    assert "measured.csv" in line
    for words in said:
        assert words in line
    assert sorted(p.name for p in tmp_path.iterdir()) == ["measured.csv"]


FILES = {
    "empty": (b"", "the file is empty"),
    "blank": (b"\n \n", "the file is empty"),
    "binary": (b"\x00\x01\x02" * 40, "is no text"),
    "no header": (b"1.5,2,3\n4,5,6\n", "line 1: '1.5,2,3' is no header; expected names with units"),
    "ragged": (b"J1 [deg];J2 [deg]\n1;2;3\n", "more cells than the header"),
    "cut between cells": (b"J1 [deg],x [mm],y [mm]\n1,2.50,3\n4,5.00,6\n7,8.0", "ends within a row, at '7,8.0'"),
    "cut in the last cell": (b"J1 [deg],x [mm]\n1,2.50\n4,5.00\n7,8.0", "ends within a row, at '7,8.0'"),
    "decimal commas between commas": (b"J1 [deg],J2 [deg]\n1,5,2,5\n", "decimal commas"),
}


@pytest.mark.parametrize("case", FILES)
def test_bad_file_is_refused(case: str, tmp_path: Path) -> None:
    content, said = FILES[case]
    path = tmp_path / "measured.csv"
    path.write_bytes(content)
    line = one_line(run("check", path, "--mechanism", "irb6400r"), 2)
    assert "measured.csv" in line
    assert said in line


def test_missing_table_names_the_file(tmp_path: Path) -> None:
    line = one_line(run("check", tmp_path / "nothing.csv", "--mechanism", "irb6400r"), 2)
    assert "nothing.csv" in line
    assert "cannot be read" in line


@pytest.mark.long
def test_one_of_two_groups_is_held_out(tmp_path: Path) -> None:
    side = ["left" if i % 2 else "right" for i in range(len(GOOD))]
    path = write(GOOD.assign(group=side), tmp_path / "measured.csv")
    assert run("calibrate", path, "--mechanism", "irb6400r", "--out", tmp_path / "out", "--quiet").exit_code == 0
    held = pd.read_csv(tmp_path / "out" / "poses.csv")["set"]
    assert sorted(set(zip(side, held, strict=True))) in (
        [("left", "held out"), ("right", "training")], [("left", "training"), ("right", "held out")],
    )  # fmt: skip


def test_payload_said_twice_is_refused(tmp_path: Path) -> None:
    path = write(GOOD.assign(**{"payload [kg]": "10"}), tmp_path / "measured.csv")
    line = one_line(run("calibrate", path, "--mechanism", "irb6400r", "--payload", "5kg"), 2)
    assert "--payload: 5 kg, and the payload column of measured.csv has 10 kg" in line


def test_a_payload_said_twice_alike_is_taken_once(tmp_path: Path) -> None:
    path = write(GOOD.assign(**{"payload [kg]": "10"}), tmp_path / "measured.csv")
    assert set(gp.read_table(path, gp.load_mechanism("irb6400r", payload="10kg")).payload) == {10.0}


@pytest.mark.usefixtures("brief")
def test_out_that_is_a_file_is_refused_and_kept(tmp_path: Path) -> None:
    path = write(GOOD, tmp_path / "measured.csv")
    kept = tmp_path / "out"
    kept.write_text("mine")
    line = one_line(run("calibrate", path, "--mechanism", "irb6400r", "--quiet", "--out", kept), 2)
    assert "expected a folder" in line
    assert kept.read_text() == "mine"


OPTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "unknown effect": (("--effect", "gremlins"), ("'gremlins' is unknown", "base_compliance")),
    "effect of an unknown input": (
        ("--effect", "J1.moving:Rz:sin(temperature)"),
        ("'temperature' is neither in the table", "torque_J6"),
    ),
    "effect that is no expression": (("--effect", "J1.moving:Rz:sin("), ("was never closed",)),
    "effect that runs code": (("--effect", "J1.moving:Rz:__import__('os')"), ("cannot read", "the functions ")),
    "effect named twice": (
        ("--effect", "gear_harmonic J4", "--effect", "gear_harmonic J4"),
        ("--effect", "is named twice"),
    ),
    "standard fits nothing": (("--standard", "J9 *"), ("'J9 *'", "J1 Tx")),
    "unknown option": (("--efect", "x"), ("--efect", "calibrate --help")),
    "holdout of everything": (("--holdout", "1"), ("--holdout",)),
    "payload without unit": (("--payload", "60"), ("--payload", "'60' is no quantity")),
    "payload in metres": (("--payload", "60m"), ("--payload", "no unit of mass")),
    "payload centre of two": (("--payload-com", "0,0mm"), ("--payload-com", "three lengths")),
    "unknown frame": (("--frame", "gripper"), ("gripper", "flange")),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_bad_option_is_refused(case: str, tmp_path: Path) -> None:
    options, said = OPTIONS[case]
    path = write(GOOD, tmp_path / "measured.csv")
    line = one_line(run("calibrate", path, "--mechanism", "irb6400r", "--out", tmp_path / "out", *options), 2)
    for words in said:
        assert words in line
    assert sorted(p.name for p in tmp_path.iterdir()) == ["measured.csv"]


NAMED = {
    "--population": ("evolve", "--population", "20"),
    "--operators": ("evolve", "--operators", "magic"),
    "--truncation": ("evolve", "--truncation", "2"),
    "--tournament": ("evolve", "--tournament", "1000000"),
    "--representation": ("evolve", "--representation", "graph"),
    "--holdout": ("calibrate", "--holdout", "0.999"),
    "--noise": ("discover", "--noise", "3"),
    "--instrument": ("check", "--instrument", "Leica"),
    "--mechanism": ("check", "--mechanism", "hal9000"),
}


@pytest.mark.parametrize("option", NAMED)
def test_the_line_opens_with_the_name_of_the_option(option: str, tmp_path: Path) -> None:
    path = write(GOOD, tmp_path / "measured.csv")
    command, *options = NAMED[option]
    mechanism = () if option == "--mechanism" else ("--mechanism", "irb6400r")
    out = () if command == "check" else ("--out", tmp_path / "out")
    assert one_line(run(command, path, *mechanism, *out, *options), 2).startswith(f"gpmodel: {option}: ")


@pytest.mark.parametrize("command", ["check", "discover", "evolve", "fleet"])
def test_an_empty_mechanism_is_unknown(command: str, tmp_path: Path) -> None:
    path = write(GOOD, tmp_path / "measured.csv")
    assert "'' is unknown" in one_line(run(command, path, "--mechanism", ""), 2)


def test_poses_says_nothing_before_it_refuses() -> None:
    assert one_line(run("poses", "--mechanism", "irb6400r", "-n", 3, "--noise", "nan"), 2).startswith(
        "gpmodel: --noise"
    )


@pytest.mark.parametrize("path", ["a\nfit to calibrate with; no warnings\nb", "a\x1b[2Jb", "a\x00b"])
def test_a_path_forges_no_line_of_what_is_printed(path: str, tmp_path: Path) -> None:
    table = write(GOOD, tmp_path / "measured.csv")
    for words in (("check", path), ("check", table, "--out", path), ("certificate", path)):
        arm = ("--mechanism", "irb6400r") if words[0] == "check" else ()
        assert "holds control characters" in one_line(run(*words, *arm), 2)
