"""Test the reading of tables: separators, decimal commas, units, labels."""

import math
import re
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import robot
from effect_cases import mechanism
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gpmodel.api.table import dataset_of, read_table
from gpmodel.errors import InputError
from gpmodel.mechanism.source import load_mechanism
from gpmodel.table.cells import clock_seconds, frame_of, read_frame, separator_and_decimal
from gpmodel.table.dataset import LABELS
from gpmodel.table.layout import name_and_unit, read_sheets
from gpmodel.table.units import identifier

ROBOT = load_mechanism("irb6400r")
ANGLES = {"deg": math.pi / 180, "rad": 1.0}
LENGTHS = {"mm": 1e-3, "m": 1.0, "um": 1e-6, "in": 0.0254}

values = st.floats(-1e4, 1e4, allow_nan=False).map(lambda v: float(f"{v:.9g}"))


@st.composite
def tables(draw: st.DrawFn) -> tuple[str, np.ndarray, np.ndarray, list[str], float, float]:
    """Text of a table, and the numbers it holds: (N, 6) joints, (N, 3) positions with NaN for empty, groups, units."""
    rows = draw(st.integers(1, 4))
    separator, comma = draw(st.sampled_from([(",", False), (";", False), (";", True), ("\t", False), ("\t", True)]))
    angle, length = draw(st.sampled_from(sorted(ANGLES))), draw(st.sampled_from(sorted(LENGTHS)))
    space = draw(st.sampled_from(["", " "]))
    q = np.array([[draw(values) for _ in range(6)] for _ in range(rows)])
    cells = [[draw(st.none() | values) for _ in range(3)] for _ in range(rows)]
    cells[0][0] = cells[0][0] or 1.0
    p = np.array([[math.nan if v is None else v for v in row] for row in cells])
    groups = [draw(st.sampled_from(["a", "b c", "7"])) for _ in range(rows)]
    header = [f"J{i}{space}[{angle}]" for i in range(1, 7)] + [f"{a}{space}[{length}]" for a in "xyz"] + ["group"]
    order = draw(st.permutations(range(len(header))))

    def text(value: float) -> str:
        return "" if math.isnan(value) else repr(float(value)).replace(".", "," if comma else ".")

    lines = [[header[i] for i in order]]
    for angles, lengths, group in zip(q, p, groups, strict=True):
        row = [*map(text, angles), *map(text, lengths), group]
        lines.append([row[i] for i in order])
    newline = draw(st.sampled_from(["\n", "\r\n"]))
    mark = draw(st.sampled_from(["", "\ufeff"]))
    return (
        mark + newline.join(separator.join(line) for line in lines) + newline,
        q,
        p,
        groups,
        ANGLES[angle],
        LENGTHS[length],
    )


@pytest.mark.long
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(made=tables())
def test_any_spelling_of_a_table_gives_its_numbers(made: tuple, tmp_path: Path) -> None:
    text, q, p, groups, angle, length = made
    path = tmp_path / "any.csv"
    path.write_bytes(text.encode())
    data = read_table(path, ROBOT)
    np.testing.assert_allclose(data.q, q * angle, rtol=1e-12)
    np.testing.assert_allclose(data.position, p * length, rtol=1e-12)
    assert data.label("group").tolist() == groups
    assert data.row.tolist() == list(range(1, len(q) + 1))


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    mechanism, made = robot(
        12,
        inputs={"temperature": np.linspace(20.0, 25.0, 12)},
        input_units={"temperature": "degC"},
        payload=np.arange(12.0),
    )
    path = tmp_path / "again.csv"
    frame_of(made.dataset, mechanism).to_csv(path, index=False)
    data = read_table(path, mechanism)
    np.testing.assert_allclose(data.q, made.dataset.q, atol=1e-11)
    np.testing.assert_allclose(data.position, made.dataset.position, atol=1e-9)
    np.testing.assert_allclose(data.payload, made.dataset.payload)
    np.testing.assert_allclose(data.extras["temperature"], made.dataset.extras["temperature"])
    assert data.extra_units["temperature"] == "degC"
    assert data.payload_given


def test_joints_go_by_their_names_or_by_number(tmp_path: Path) -> None:
    mechanism = load_mechanism("ur5")
    q = np.arange(12.0).reshape(2, 6) / 10
    for names in ([j.name for j in mechanism.joints], [f"J{i}" for i in range(1, 7)]):
        path = tmp_path / "named.csv"
        pd.DataFrame(q, columns=[f"{n} [rad]" for n in names]).assign(**{"x [m]": 1.0}).to_csv(path, index=False)
        np.testing.assert_allclose(read_table(path, mechanism).q, q)


@pytest.mark.parametrize("texts", [False, True])
def test_excel_tables_are_read_from_the_first_sheet_with_numbers(texts: bool, tmp_path: Path) -> None:
    mechanism, made = robot(5)
    path = tmp_path / "measured.xlsx"
    frame = frame_of(made.dataset, mechanism)
    commas = frame.map(lambda cell: str(cell).replace(".", ","))
    with pd.ExcelWriter(path) as book:
        pd.DataFrame({"operator": ["nobody"]}).to_excel(book, sheet_name="notes", index=False)
        (commas if texts else frame).to_excel(book, sheet_name="poses", index=False)
    np.testing.assert_allclose(read_table(path, mechanism).position, made.dataset.position, atol=1e-9)


@pytest.mark.parametrize("column", LABELS)
def test_labels_are_text_and_empty_where_absent(column: str, tmp_path: Path) -> None:
    mechanism, made = robot(3)
    frame = frame_of(made.dataset, mechanism)
    path = tmp_path / "labels.csv"
    frame.to_csv(path, index=False)
    assert dataset_of(path, mechanism, need_measurement=False).label(column).tolist() == ["", "", ""]
    frame.assign(**{column: ["1", "", "two"]}).to_csv(path, index=False)
    assert dataset_of(path, mechanism, need_measurement=False).label(column).tolist() == ["1", "", "two"]


def test_distances_and_rotations_are_measurements(tmp_path: Path) -> None:
    header = ",".join(f"J{i} [deg]" for i in range(1, 7))
    path = tmp_path / "d.csv"
    path.write_text(f"{header},distance_A [mm],rx [deg],ry [deg],rz [deg]\n1,2,3,4,5,6,1500,90,0,0\n1,2,3,4,5,7,,,,\n")
    data = read_table(path, ROBOT)
    np.testing.assert_allclose(data.distances["distance_A"], [1.5, np.nan])
    np.testing.assert_allclose(data.rotation[0], [math.pi / 2, 0.0, 0.0])
    assert np.isnan(data.position).all()


def test_half_a_rotation_is_refused(tmp_path: Path) -> None:
    header = ",".join(f"J{i} [deg]" for i in range(1, 7))
    path = tmp_path / "d.csv"
    path.write_text(f"{header},rx [deg],ry [deg],rz [deg]\n1,2,3,4,5,6,90,,0\n")
    with pytest.raises(InputError, match=r"row 1: rotation is incomplete"):
        read_table(path, ROBOT)


@pytest.mark.parametrize(("encoding"), ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_encodings_of_spreadsheets(encoding: str, tmp_path: Path) -> None:
    header = ";".join(f"J{i} [deg]" for i in range(1, 7))
    path = tmp_path / "e.csv"
    path.write_bytes(f"{header};x [mm];temp [°C];group\n1;2;3;4;5;6;7,5;21,5;Köln\n".encode(encoding))
    data = read_table(path, ROBOT)
    assert data.label("group").tolist() == ["Köln"]
    assert data.extras["temp"].tolist() == [21.5]
    assert data.position[0, 0] == pytest.approx(0.0075)


TWO = "J1 [deg],J2 [deg],J3 [deg],J4 [deg],J5 [deg],J6 [deg],x [mm],y [mm],z [mm]"


@pytest.mark.parametrize(
    ("header", "row", "said"),
    [
        (TWO, "0,0,0,0,0,0,1e300,0,0", r"column 'x', row 1: 1e\+300 is no measured value"),
        (TWO, "0,0,0,0,0,0,1e12,0,0", r"x, y, z, row 1: 1e\+09 m from the instrument"),
        (TWO + ",x [mm]", "0,0,0,0,0,0,1,2,3,4", r"column 'x \[mm\]' appears twice"),
        (TWO + ",x [m]", "0,0,0,0,0,0,1,2,3,4", "column 'x' appears twice"),
        (TWO + ",", "0,0,0,0,0,0,1,2,3,4", "column 10 has no name"),
        (TWO + ",[mm]", "0,0,0,0,0,0,1,2,3,4", "column 10 has no name"),
        (TWO + ",payload [kg]", "0,0,0,0,0,0,1,2,3,-4", r"column 'payload', row 1: -4 kg; expected a mass from 0"),
        (TWO + ",payload [kg]", "0,0,0,0,0,0,1,2,3,1e5", r"column 'payload', row 1: 100000 kg; expected a mass"),
    ],
)
def test_what_no_instrument_measures_and_no_header_means_is_refused(
    tmp_path: Path, header: str, row: str, said: str
) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"{header}\n{row}\n{row}\n")
    with pytest.raises(InputError, match=said):
        read_table(path, ROBOT)


def test_text_columns_and_empty_rows_are_remembered(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(f"{TWO},operator\n0,0,0,0,0,0,1,2,3,Ann\n,,,,,,,,,\n1,0,0,0,0,0,1,2,3,Bob\n")
    data = read_table(path, ROBOT)
    assert data.ignored == ("operator",)
    assert data.empty_rows == 1


def test_a_table_of_a_gigabyte_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "large.csv").open("wb") as file:
        file.truncate(1 << 30)
    with pytest.raises(InputError, match=r"large.csv: larger than 128 MB; expected a measured table"):
        read_frame(tmp_path / "large.csv")


@pytest.mark.long
def test_an_excel_table_that_is_larger_than_it_looks_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.xlsx"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/worksheets/sheet1.xml", bytes(200 << 20))
    assert path.stat().st_size < 1 << 20
    with pytest.raises(InputError, match=r"bomb.xlsx: 200 MB unpacked, expected at most 128 MB"):
        read_frame(path)


def test_the_separator_is_that_of_the_rows_whatever_names_and_texts_contain(tmp_path: Path) -> None:
    joints = ";".join(f"J{i} [deg]" for i in range(1, 7))
    path = tmp_path / "t.csv"
    note = "note, who, where, when, why, with, whom, since, until, and, so, on"
    path.write_text(f"{joints};x [mm];y [mm];z [mm];{note}\n" + 3 * "1,5;2;3;4;5;6;100,25;200;300;a, b, c\n")
    data = read_table(path, ROBOT)
    np.testing.assert_allclose(data.position[0], [0.10025, 0.2, 0.3])


def test_the_joint_that_is_missing_is_named_as_the_table_names_joints() -> None:
    """Joints may have their own names or numbers: the spelling of which more columns are there is meant."""
    arm = load_mechanism("ur10")
    frame = frame_of(robot(5, name="ur10")[1].dataset, arm)
    named = arm.joints[4].name
    assert f"{named} [deg]" in frame
    with pytest.raises(InputError, match=f"joint column '{named}' is missing"):
        dataset_of(frame.drop(columns=f"{named} [deg]"), arm, need_measurement=True)
    numbered = {f"{j.name} [deg]": f"J{i} [deg]" for i, j in enumerate(arm.joints, 1)}
    with pytest.raises(InputError, match="joint column 'J2' is missing"):
        dataset_of(frame.rename(columns=numbered).drop(columns="J2 [deg]"), arm, need_measurement=True)


@pytest.mark.parametrize("name", ["lambda", "None", "2", "a b"])
def test_names_are_spelled_so_that_expressions_can_hold_them(name: str) -> None:
    assert compile(identifier(name), "", "eval").co_names == (identifier(name),)
    assert identifier(identifier(name)) == identifier(name)


@pytest.mark.parametrize(
    ("written", "unit"), [("°C", "degC"), ("celsius", "degC"), ("kelvin", "K"), ("℃", "degC"), ("N*m", "N*m")]
)
def test_a_unit_of_temperature_has_one_spelling(written: str, unit: str) -> None:
    """Lengths hold at 20 °C, however the unit is written."""
    q = pd.DataFrame({f"J{k} [deg]": [1.0, 2.0] for k in range(1, 7)} | {f"air [{written}]": [300.0, 301.0]})
    assert dataset_of(q, load_mechanism("irb6400r"), need_measurement=False).extra_units == {"air": unit}


def test_axes_called_like_coordinates_in_capitals() -> None:
    columns = {"X [mm]": [1.0, 2.0], "Y [mm]": 3.0, "Z [mm]": 4.0, "x [mm]": 5.0, "y [mm]": 6.0, "z [mm]": 7.0}
    read = dataset_of(pd.DataFrame(columns), mechanism("gantry"), need_measurement=True)
    np.testing.assert_allclose(read.q, [[0.001, 0.003, 0.004], [0.002, 0.003, 0.004]])
    np.testing.assert_allclose(read.position, [[0.005, 0.006, 0.007]] * 2)


@pytest.mark.parametrize(
    "stamps",
    [("2026-11-28T23:59:58.5Z", "2026-11-29T00:00:00.25Z"), ("2026-03-02 10:00:00.5Z", "2026-03-02 10:00:02.25Z"),
     ("10:00:00.5", "10:00:02.25"), ("02.03.2026 10:00:00.5", "02.03.2026 10:00:02.25"), ("23:59:58.5", "00:00:00.25"),
     ("11:59:58.5 PM", "12:00:00.25 AM")],
)  # fmt: skip
def test_clock_times_are_seconds_after_the_first(stamps: tuple[str, str]) -> None:
    columns = {f"J{k} [deg]": [1.0, 2.0] for k in range(1, 7)} | {"measured at": list(stamps), "operator": ["a", "b"]}
    read = dataset_of(pd.DataFrame(columns), load_mechanism("irb6400r"), need_measurement=False)
    np.testing.assert_allclose(read.extras["measured_at"], [0.0, 1.75])
    assert (read.extra_units["measured_at"], read.ignored) == ("s", ("operator",))


@pytest.mark.parametrize(
    ("stamps", "seconds"),
    [(("23:00", "10:30", "20:00", "01:00"), (0.0, 41400.0, 75600.0, 93600.0)),
     (("10:00", "09:00", "17:00"), (3600.0, 0.0, 28800.0)),
     (("2026-03-03 10:00", "2026-03-02 09:00", "2026-03-02 11:00"), (90000.0, 0.0, 7200.0))],
)  # fmt: skip
def test_only_times_that_fall_by_more_than_half_a_day_are_of_the_next_day(
    stamps: tuple[str, ...], seconds: tuple[float, ...]
) -> None:
    np.testing.assert_allclose(clock_seconds(pd.Series(stamps)), seconds)


@pytest.mark.parametrize(
    ("row", "expected"),
    [("126,983;-12,500", (";", ",")), ("126,9837;-12,5001", (";", ",")), ("1.234,5;12,250", (";", ",")),
     ("1,234.5;12.250", (";", ".")), ("126.983,-12.500", (",", ".")), ("126.983;-12.500", (";", "."))],
)  # fmt: skip
def test_a_decimal_sign_is_no_sign_of_thousands(row: str, expected: tuple[str, str]) -> None:
    assert separator_and_decimal(["first;second" if ";" in row else "first,second", *[row] * 4]) == expected


def with_units(angle: str, length: str, header: str, separator: str = ",", decimal: str = ".") -> str:
    """A table of two poses with a unit behind every number, and an empty reading."""
    rows = [[10.5, -20.25, 30.0, 40.125, 50.0, -60.0, 1500.5, None, 800.0], [0, 5, 10, 15, 20, 25, 1400, 10, 900.25]]
    cells = [
        [*(f"{v}{angle}" for v in row[:6]), *("" if v is None else f"{v}{length}" for v in row[6:])] for row in rows
    ]
    lines = [separator.join([*(f"J{i}" for i in range(1, 7)), *(f"{axis}{header}" for axis in "xyz")])]
    return "\n".join([*lines, *(separator.join(row).replace(".", decimal) for row in cells)]) + "\n"


@pytest.mark.parametrize(
    ("angle", "length", "header", "separator", "decimal"),
    [("°", " mm", "", ",", "."), (" deg", "mm", " [mm]", ";", ","), ("°", "\u00a0mm", "", ";", "."),
     (" Grad", " mm", "", "\t", ",")],
)  # fmt: skip
def test_a_unit_behind_every_number_is_that_of_the_column(
    angle: str, length: str, header: str, separator: str, decimal: str, tmp_path: Path
) -> None:
    (tmp_path / "t.csv").write_text(with_units(angle, length, header, separator, decimal), encoding="utf-8")
    data = read_table(tmp_path / "t.csv", ROBOT)
    np.testing.assert_allclose(np.degrees(data.q[0]), [10.5, -20.25, 30.0, 40.125, 50.0, -60.0])
    np.testing.assert_allclose(data.position, [[1.5005, np.nan, 0.8], [1.4, 0.01, 0.90025]])
    (sheet,) = read_sheets(tmp_path / "t.csv")
    assert [name_and_unit(name)[1] for name in sheet.names] == ["deg"] * 6 + ["mm"] * 3


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("1400 mm", "1.4 m", "row 2: '1.4 m' is [m], row 1 is '1500.5 mm'; expected one unit in all cells"),
        ("1400 mm", "1400", "row 2: '1400' is without unit, row 1 is '1500.5 mm'; expected one unit in all cells"),
        (",x,", ",x [m],", "cells in [mm]; expected the unit of the header"),
        ("1400 mm", "1400 bolts", "'1500.5 mm' is no number"),
    ],
)
def test_two_units_in_a_column_are_refused_in_one_line(old: str, new: str, said: str, tmp_path: Path) -> None:
    text = with_units("°", " mm", "").replace("J6,x,", "J6,x [mm],") if "bolts" in new else with_units("°", " mm", "")
    (tmp_path / "t.csv").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape(said)) as error:
        read_table(tmp_path / "t.csv", ROBOT)
    assert "\n" not in str(error.value)


def test_labels_with_units_stay_labels(tmp_path: Path) -> None:
    text = with_units("°", " mm", "").replace("z\n", "z,tool\n").replace("800.0 mm\n", "800.0 mm,10 mm\n")
    (tmp_path / "t.csv").write_text(text.replace("900.25 mm\n", "900.25 mm,20 mm\n"), encoding="utf-8")
    assert read_table(tmp_path / "t.csv", ROBOT).label("tool").tolist() == ["10 mm", "20 mm"]
