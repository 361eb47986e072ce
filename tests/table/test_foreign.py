"""Test that files of other programs become tables or are refused in one line."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from gpmodel.cli.import_ import import_table
from gpmodel.errors import InputError
from gpmodel.table.foreign import ColumnMap, import_file, read_map, unread
from gpmodel.table.join import read_files
from gpmodel.table.layout import name_and_unit, read_sheets
from gpmodel.table.read import dataset_from
from robots import load_mechanism

JOINTS = "\n".join(f'J{i} = "q{i} [rad]"' for i in range(1, 7))
POINT = 'x = "px [mm]"\ny = "py [mm]"\nz = "pz [mm]"'
HEADER = [*(f"q{i}" for i in range(1, 7)), "px", "py", "pz", "dx", "a", "b", "c", "d", "day"]
ANGLES = np.radians([[10.0, 20.0, 30.0], [-40.0, 5.0, 170.0], [0.0, -60.0, 12.5]])


def rows(orientation: np.ndarray) -> list[list[float | str]]:
    fourth = orientation[:, 3:] if orientation.shape[1] == 4 else np.zeros((3, 1))
    return [
        [*(0.1 * i + k for i in range(1, 7)), 100.5 + k, -200.25, 300.0, 0.5, *orientation[k][:3], fourth[k, 0], name]
        for k, name in enumerate(("day 0", "day 1", "day 2"))
    ]


def write(
    folder: Path, mapping: str, orientation: np.ndarray = ANGLES, separator: str = ",", decimal: str = "."
) -> tuple[Path, Path]:
    def cell(value: float | str) -> str:
        return value if isinstance(value, str) else repr(float(value)).replace(".", decimal)

    lines = [separator.join(HEADER), *(separator.join(cell(v) for v in row) for row in rows(orientation))]
    (folder / "foreign.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "map.toml").write_text(mapping, encoding="utf-8")
    return folder / "foreign.csv", folder / "map.toml"


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ","), (";", "."), ("\t", ",")])
def test_separator_and_decimal_sign_are_found_out(tmp_path: Path, separator: str, decimal: str) -> None:
    file, mapping = write(tmp_path, f"[columns]\n{JOINTS}\n{POINT}", separator=separator, decimal=decimal)
    mechanism = load_mechanism("ur5")
    assert mechanism is not None
    dataset = dataset_from(import_file(read_sheets(file)[0], read_map(mapping)), file, mechanism)
    assert dataset.q[2] == pytest.approx([2.1, 2.2, 2.3, 2.4, 2.5, 2.6], abs=1e-12)
    assert dataset.position[1] == pytest.approx([0.1015, -0.20025, 0.3], abs=1e-12)


@pytest.mark.parametrize("line", ["\u221212.5;1\u202f234.5;0.1", "-12,5°;1\u00a0234,5;0,1", "-12.5;1\u2019234.5;0.1",
                                  "-12.5°;1'234.5;1e-1"])  # fmt: skip
def test_typeset_numbers_are_numbers(tmp_path: Path, line: str) -> None:
    (tmp_path / "typeset.csv").write_text("J1;x;y\n" + f"{line}\n" * 3, encoding="utf-8")
    (sheet,) = read_sheets(tmp_path / "typeset.csv")
    assert sheet.cells.astype(float).to_numpy().tolist() == [[-12.5, 1234.5, 0.1]] * 3


@pytest.mark.parametrize(
    ("header", "expected"),
    [("Temperature in °C", ("Temperature", "degC")), ("Temp °C", ("Temp", "degC")), ("J1 °", ("J1", "deg")),
     ("X_mm", ("X", "mm")), ("A1/Grad", ("A1", "deg")), ("dz µm", ("dz", "um"))],
)  # fmt: skip
def test_a_unit_behind_a_name_is_its_unit(header: str, expected: tuple[str, str]) -> None:
    assert name_and_unit(header) == (*expected, False)


def test_arithmetic_labels_and_inputs(tmp_path: Path) -> None:
    mapping = f'[columns]\n{JOINTS}\nx = "px - 2*dx [mm]"\nwarmth = "px/100 [degC]"\ngroup = "day"'
    file, path = write(tmp_path, mapping)
    frame = import_file(read_sheets(file)[0], read_map(path))
    assert frame["x [mm]"].astype(float).tolist() == [99.5, 100.5, 101.5]
    assert frame["warmth [degC]"].astype(float).tolist() == [1.005, 1.015, 1.025]
    assert frame["group"].tolist() == ["day 0", "day 1", "day 2"]
    assert unread(read_sheets(file)[0], read_map(path)) == ("not in map.toml: py, pz, a, b, c, d",)


def test_an_empty_cell_stays_empty_through_a_formula(tmp_path: Path) -> None:
    file, path = write(tmp_path, f'[columns]\n{JOINTS}\nx = "px - dx [mm]"')
    file.write_text(file.read_text().replace("101.5", "", 1))
    assert import_file(read_sheets(file)[0], read_map(path))["x [mm]"].tolist() == ["100.0", "", "102.0"]


@pytest.mark.parametrize(
    ("convention", "unit", "written"),
    [
        ("intrinsic XYZ", "rad", lambda r: r.as_euler("XYZ")),
        ("intrinsic ZYZ", "rad", lambda r: r.as_euler("ZYZ")),
        ("fixed XYZ", "deg", lambda r: r.as_euler("xyz", degrees=True)),
        ("rotation vector", "deg", lambda r: r.as_rotvec(degrees=True)),
        ("quaternion xyzw", "", lambda r: r.as_quat()),
        ("quaternion wxyz", "", lambda r: r.as_quat(scalar_first=True)),
    ],
)
def test_orientations_become_rotation_vectors(tmp_path: Path, convention: str, unit: str, written) -> None:
    truth = Rotation.from_rotvec(ANGLES)
    numbers = written(truth)
    columns = [f'"{c}{f" [{unit}]" if unit else ""}"' for c in "abcd"[: numbers.shape[1]]]
    mapping = f'[columns]\n{JOINTS}\n[orientation]\ncolumns = [{", ".join(columns)}]\nconvention = "{convention}"'
    file, path = write(tmp_path, mapping, numbers)
    frame = import_file(read_sheets(file)[0], read_map(path))
    vectors = np.radians(frame[["rx [deg]", "ry [deg]", "rz [deg]"]].astype(float).to_numpy())
    assert np.abs((Rotation.from_rotvec(vectors) * truth.inv()).magnitude()).max() < 1e-12


def test_intrinsic_xyz_is_the_product_of_the_three_turns(tmp_path: Path) -> None:
    def turn(axis: int, angle: float) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        out = np.eye(3)
        first, second = (axis + 1) % 3, (axis + 2) % 3
        out[[first, first, second, second], [first, second, first, second]] = c, -s, s, c
        return out

    mapping = (
        f'[columns]\n{JOINTS}\n[orientation]\ncolumns = ["a [rad]", "b [rad]", "c [rad]"]\nconvention = "intrinsic XYZ"'
    )
    file, path = write(tmp_path, mapping)
    frame = import_file(read_sheets(file)[0], read_map(path))
    vector = np.radians(frame.loc[1, ["rx [deg]", "ry [deg]", "rz [deg]"]].astype(float).to_numpy())
    a, b, c = ANGLES[1]
    product = turn(0, a) @ turn(1, b) @ turn(2, c)
    assert np.abs(Rotation.from_rotvec(vector).as_matrix() - product).max() < 1e-12


@pytest.mark.parametrize(
    ("mapping", "said"),
    [
        ("columns = 3", "expected a table [columns]"),
        ("[columns", "is no TOML"),
        (f"[columns]\n{JOINTS}\n[rows]\na = 1", "'rows' is unknown"),
        ('[columns]\nx = "px"', "no unit"),
        ('[columns]\nx = "px [furlongs per]"', "no known unit"),
        ('[columns]\nx = "p_x [mm]"', "has no column 'p_x'; it has px, "),
        ('[columns]\nx = "px - p_x [mm]"', "has no column 'p_x'; it has px, "),
        ('[columns]\nx = "px - [mm]"', "has no column 'px -'"),
        ('[columns]\nx = "day [mm]"', "'day 0' is no number"),
        ('[columns]\ngroup = "shift"', "has no column 'shift'"),
        ('[columns]\nx = "px [mm]"\n[orientation]\ncolumns = ["a", "b", "c"]', "[orientation]: expected"),
        ('[columns]\nx = "px [mm]"\n[orientation]\ncolumns = ["a", "b", "c"]\nconvention = "rpy"', "'rpy' is unknown"),
        ('[columns]\nx = "px [mm]"\n[orientation]\ncolumns = ["a"]\nconvention = "fixed XYZ"', "expected 3 texts"),
        ('[columns]\nx = "px [mm]"\n[orientation]\ncolumns = ["a", "b", "c"]\nconvention = "fixed XYZ"', "has no unit"),
        ('[columns]\nrx = "a [deg]"\n[orientation]\ncolumns = ["a", "b", "c"]\nconvention = "fixed XYZ"', "both given"),
    ],
)  # fmt: skip
def test_a_bad_map_is_one_clear_line(tmp_path: Path, mapping: str, said: str) -> None:
    file, path = write(tmp_path, mapping)
    with pytest.raises(InputError) as caught:
        import_file(read_sheets(file)[0], read_map(path))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_command_writes_the_table_or_prints_it(tmp_path: Path) -> None:
    file, path = write(tmp_path, f"[columns]\n{JOINTS}\n{POINT}")
    run = CliRunner().invoke(import_table, [str(file), "--map", str(path), "--out", str(tmp_path / "table.csv")])
    assert run.exit_code == 0
    assert "3 rows, 10 columns" in run.output
    printed = CliRunner().invoke(import_table, [str(file), "--map", str(path)])
    assert printed.stdout == (tmp_path / "table.csv").read_text()
    assert printed.stdout.splitlines()[0].startswith("J1 [rad],J2 [rad]")


def test_the_file_itself_is_never_overwritten(tmp_path: Path) -> None:
    file, path = write(tmp_path, f"[columns]\n{JOINTS}\n{POINT}")
    before = file.read_bytes()
    run = CliRunner().invoke(import_table, [str(file), "--map", str(path), "--out", str(file)])
    assert isinstance(run.exception, InputError)
    assert file.read_bytes() == before


def test_a_column_is_named_with_its_unit_without_it_or_by_number(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("J1 [deg],X (mm),J 3 [deg]\n1,2,3\n4,5,6\n")
    for text in ("J1 [deg]", "J1 [deg] [deg]", "c1 [deg]", "1 [deg]", "c3 - X [deg]", "J_3__deg_ - c2 [deg]"):
        sheet = read_sheets(tmp_path / "t.csv")[0]
        assert import_file(sheet, ColumnMap({"J1": text})).iloc[0, 0] == "1.0", text
    with pytest.raises(
        InputError, match=r"'J1 \[deg\]' is in \[deg\]; expected \[deg\], or 'J1 \[deg\] \[rad\]' for a wrong header"
    ):
        import_file(sheet, ColumnMap({"J1": "J1 [rad]"}))


def test_a_file_without_a_header_goes_by_numbers(tmp_path: Path) -> None:
    (tmp_path / "t.txt").write_text("a b c\n1 2 3\n4 5 6\n")
    (tmp_path / "m.toml").write_text('header = false\n[columns]\nJ1 = "2 [deg]"\nx = "c3 - c1 [mm]"\n')
    columns = read_map(tmp_path / "m.toml")
    sheet = read_sheets(tmp_path / "t.txt", columns.header)[0]
    assert sheet.names == ("", "", "")
    assert import_file(sheet, columns)["x [mm]"].tolist() == ["2.0", "2.0"]


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("order", "t.csv: 3 rows, u.csv has 2; expected equal numbers, or --join with a column of both files"),
        ("no = No", "t.csv has no column 'no'; it has N"),
        ("N = x", "no common value of 'N = x'"),
        ("rows 1-2 = 1-3", "'1-2 = 1-3'; expected equal numbers of rows"),
        ("rows 1-9 = 1-9", "expected rows within both files: t.csv has 3 rows, u.csv 2"),
        ("rows all", "'all'; expected equal numbers of rows"),
        ("time N = M", "no times; expected clock times or numbers"),
    ],
)
def test_what_cannot_be_joined_is_one_line(how: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("N,J1\n1,10\n2,20\n3,30\n")
    (tmp_path / "u.csv").write_text("M,x\np3,7.5\np1,8.5\n")
    with pytest.raises(InputError) as caught:
        read_files((tmp_path / "t.csv", tmp_path / "u.csv"), how)
    assert said in str(caught.value)
    joined = read_files((tmp_path / "t.csv", tmp_path / "u.csv"), "N = M")
    assert joined.cells.to_numpy().tolist() == [["3", "30", "p3", "7.5"], ["1", "10", "p1", "8.5"]]
    assert "rows of t.csv without a partner: 2" in joined.said


ABB = "  CONST jointtarget j{0}:=[[{0},2,3,4,5,6],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];"
ABB_OWN = "  CONST robtarget p{0}:=[[{0}.5,2,3],[1,0,0,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];"
KUKA = "PTP {{A1 {0},A2 2,A3 3,A4 4,A5 5,A6 6,E1 0}}"
KUKA_OWN = "DECL E6POS XP{0}={{X {0}.5,Y 2,Z 3,A 4,B 5,C 6,S 2,T 35}}"
FANUC = (
    "P[{0}]{{\n GP1:\n\tUF : 0, UT : 1,\n\tJ1= {0} deg, J2= 2.0 deg, J3= 3 deg,\n\tJ4= 4 deg, J5= 5 deg, J6= 6 deg\n}};"
)
FANUC_OWN = (
    "P[{0}]{{\n GP1:\n\tUF : 0, UT : 1,\n\tX = {0}.5 mm, Y = 2 mm, Z = 3 mm,\n\tW = 4 deg, P = 5 deg, R = 6 deg\n}};"
)


@pytest.mark.parametrize(("joints", "own"), [(ABB, ABB_OWN), (KUKA, KUKA_OWN), (FANUC, FANUC_OWN)])
def test_joint_values_of_a_program_are_read_and_positions_of_its_controller_are_not(
    joints: str, own: str, tmp_path: Path
) -> None:
    file = tmp_path / "cell.txt"
    file.write_text("\n".join(line.format(k) for k in range(1, 9) for line in (joints, own)))
    sheet = read_sheets(file)[0]
    assert len(sheet.cells) == 8
    assert "8 positions of the controller left out" in sheet.said[0]
    assert {"2", "3", "4", "5", "6"} <= {str(cell).removesuffix(".0") for cell in sheet.cells.iloc[0]}
    file.write_text("\n".join(own.format(k) for k in range(1, 9)))
    with pytest.raises(
        InputError, match="8 positions that the controller computed, and no joint values; expected joint"
    ):
        read_sheets(file)[0]


@pytest.mark.parametrize(("kind", "what"), [("PULSE", "pulses of the encoders"), ("USER", "positions that the contr")])
def test_a_job_of_yaskawa_is_refused_by_the_kind_of_its_positions(kind: str, what: str, tmp_path: Path) -> None:
    file = tmp_path / "cal.jbi"
    points = "\n".join(f"C{k:05d}={k},15170,-34133,0,-36409,0" for k in range(8))
    file.write_text(f"/JOB\n//POS\n///NPOS 8,0,0,0,0,0\n///POSTYPE {kind}\n{points}\n//INST\nNOP\nEND\n")
    with pytest.raises(InputError, match=f"{what}.*expected joint values in degrees"):
        read_sheets(file)[0]
