"""Test that columns of foreign files are identified, or refused with the reason."""

from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import run
from instances import some
from scipy.spatial.transform import Rotation

import gpmodel as gp
from gpmodel.arrays import Array
from gpmodel.checks.guess import Guess, guess_files
from gpmodel.checks.notes import flange, registered
from gpmodel.errors import InputError
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.table.dataset import Dataset
from gpmodel.table.foreign import ColumnMap, import_file, read_map
from gpmodel.table.join import read_files
from gpmodel.table.read import dataset_from
from gpmodel.texts import toml_text

ROWS = 30


@cache
def measured() -> tuple[Mechanism, Array, Array]:
    """An arm, its joint values (N, 6), deg, and measured positions (N, 3), mm."""
    made = gp.simulate("irb6400r", poses=ROWS, noise="0.02mm", geometry_sigma="0.3mm", seed=4)
    return gp.load_mechanism("irb6400r"), np.round(np.degrees(made.table.q), 4), np.round(1e3 * made.table.position, 3)


def write(
    path: Path, head: Sequence[str], *blocks: object, separator: str = ",", comma: bool = False, encoding: str = "utf-8"
) -> Path:
    """A file with lines above and columns of numbers (N,), (N, k) or texts."""
    parts = [[[c] if np.ndim(c) == 0 else list(c) for c in block] for block in blocks]  # type: ignore[call-overload]
    rows = [separator.join(str(c) for part in row for c in part) for row in zip(*parts, strict=True)]
    path.write_text("\n".join([*head, *(r.replace(".", ",") if comma else r for r in rows)]) + "\n", encoding=encoding)
    return path


def read(*paths: Path, join: str | None = None) -> tuple[Dataset, Guess]:
    """The table that is guessed; the map repeats it."""
    arm = measured()[0]
    sheet, found = guess_files(paths, arm, join)
    table = import_file(sheet, found.map)
    saved = paths[0].with_suffix(".toml")
    saved.write_text(toml_text(found.map.content()))
    again: ColumnMap = read_map(saved)
    assert import_file(read_files(paths, again.join, again.header), again).equals(table)
    return dataset_from(table, paths[0], arm), found


def same(data: Dataset, kept: Sequence[int] = range(ROWS)) -> None:
    _, q, p = measured()
    np.testing.assert_allclose(np.degrees(data.q), q[list(kept)], atol=2e-4)
    np.testing.assert_allclose(1e3 * data.position, p[list(kept)], atol=2e-3)


def numbered(name: str, first: int = 1) -> list[str]:
    return [name.format(i) for i in range(first, first + 6)]


HEADERS: dict[str, tuple[list[str], float, float, dict[str, object]]] = {
    "brackets, capitals": ([",".join([*numbered("J{} [deg]"), "X  [mm]", "Y  [mm]", "Z  [mm]"])], 1, 1, {}),
    "parentheses": ([",".join([*numbered("Joint {} (deg)"), "X (mm)", "Y (mm)", "Z (mm)"])], 1, 1, {}),
    "underscores": (["\t".join([*numbered("axis{}_rad"), "pos_x_m", "pos_y_m", "pos_z_m"])], np.pi / 180, 1e-3,
                    {"separator": "\t"}),
    "nowhere, from zero": ([" ".join([*numbered("actual_q_{}", 0), *"xyz"])], np.pi / 180, 1, {"separator": " "}),
    "decimal commas": (["Prüfer: Müller", ";".join([*numbered("A{} [°]"), *(f"{a}-Ist" for a in "XYZ")])], 1, 1,
                       {"separator": ";", "comma": True, "encoding": "latin-1"}),
    "a line of units": (["|".join([*numbered("J{}"), *"xyz"]), "|".join([*["deg"] * 6, *["in"] * 3])], 1, 1 / 25.4,
                        {"separator": "|"}),
    "no header": ([], 1, 1, {"separator": " "}),
    "a byte order mark": (["\t".join([*numbered("J{}"), *"XYZ"])], 1, 1, {"separator": "\t", "encoding": "utf-16"}),
}  # fmt: skip


@pytest.mark.parametrize("case", some(HEADERS, "no header", "a line of units", "decimal commas"))
def test_a_header_of_any_form_is_read(case: str, tmp_path: Path) -> None:
    head, turn, length, how = HEADERS[case]
    _, q, p = measured()
    blocks = (np.round(turn * q, 7), np.round(length * p, 6))
    data, found = read(write(tmp_path / "t.txt", head, *blocks, **how))  # type: ignore[arg-type]
    same(data)
    assert not found.doubts


def orientations(convention: str) -> Array:
    """Return the flange's orientation as an instrument writes it, with the usual digits."""
    arm, q, p = measured()
    frames = flange(arm, np.radians(q))
    shaken = Rotation.from_rotvec(2e-4 * np.random.default_rng(1).normal(size=(ROWS, 3)))
    turn = Rotation.from_matrix(registered(frames, 1e-3 * p).turn @ frames[:, :3, :3]) * shaken
    written = {
        "quaternion xyzw": lambda: turn.as_quat(),
        "quaternion wxyz": lambda: turn.as_quat(scalar_first=True),
        "intrinsic ZYX": lambda: turn.as_euler("ZYX", degrees=True),
        "intrinsic ZYZ": lambda: turn.as_euler("ZYZ", degrees=True),
        "rotation vector": lambda: turn.as_rotvec(),
    }
    return np.asarray(np.round(written[convention](), 6))


@pytest.mark.parametrize(
    "convention",
    some(
        ["quaternion xyzw", "quaternion wxyz", "intrinsic ZYX", "intrinsic ZYZ", "rotation vector"],
        "quaternion wxyz",
        "intrinsic ZYX",
    ),
)
def test_conventions_of_orientations_are_recognised(convention: str, tmp_path: Path) -> None:
    _, q, p = measured()
    numbers = orientations(convention)
    head = ",".join([*numbered("J{}"), "x", "y", "z", *"abcd"[: numbers.shape[1]]])
    data, found = read(write(tmp_path / "t.csv", [head], q, p, numbers))
    assert found.map.orientation is not None
    assert found.map.orientation.convention == convention
    assert data.has_rotation


def test_the_coupling_of_a_pendant_is_undone(tmp_path: Path) -> None:
    _, q, p = measured()
    shown = q.copy()
    shown[:, 2] -= q[:, 1]
    data, found = read(write(tmp_path / "t.csv", [",".join([*numbered("J{}"), "x", "y", "z"])], np.round(shown, 4), p))
    same(data)
    assert found.map.columns["J3"] == "c2 + c3 [deg]"
    assert "'J3' should probably be 'J3' + 'J2'" in found.lines[0]


@pytest.mark.parametrize("places", some([",X [mm],Y [mm],Z [mm]", ",,,"], ",,,"))
@pytest.mark.parametrize("unit", some(["deg", "rad"], "deg"))
@pytest.mark.parametrize(
    ("signs", "zeros", "said"),
    [
        pytest.param((1, 1, 1, 1, 1, 1), (0, 90, 0, 0, 0, 0), "another joint zero", marks=pytest.mark.long),
        pytest.param((1, 1, 1, 1, -1, 1), (0, -90, 0, 0, 0, 0), "another joint zero", marks=pytest.mark.long),
        pytest.param((1, 1, 1, 1, 1, 1), (0, 90, -90, 0, 0, 0), "another joint zero", marks=pytest.mark.long),
        pytest.param((1, -1, 1, 1, -1, 1), (0, 0, 0, 0, 0, 0), "the opposite sign", marks=pytest.mark.long),
        ((1, -1, -1, 1, -1, 1), (0, 90, -90, 0, 0, 0), "another joint zero"),
    ],
)
def test_zeros_and_signs_of_a_controller_are_undone(
    unit: str, places: str, signs: tuple[int, ...], zeros: tuple[int, ...], said: str, tmp_path: Path
) -> None:
    _, q, p = measured()
    shown = np.array(signs) * q + zeros
    shown = np.round(shown if unit == "deg" else np.radians(shown), 7)
    header = [",".join([f"A{i} [{unit}]" for i in range(1, 7)]) + places]
    data, found = read(write(tmp_path / "t.csv", header, shown, p))
    same(data)
    assert not found.doubts
    assert any(said in line for line in found.lines)


def test_several_reflectors_are_tools_and_equal_coordinates_no_point(tmp_path: Path) -> None:
    arm, q, p = measured()
    frames = flange(arm, np.radians(q))
    found = registered(frames, 1e-3 * p)
    apart = frames[:, :3, :3] @ np.array([0.1, 0.0, 0.05]) @ found.turn.T
    second = np.round(p + 1e3 * apart, 3)
    second[7] = -9999.0
    data, _ = read(write(tmp_path / "t.csv", [",".join([*numbered("J{}"), *"XYZ", "X", "Y", "Z"])], q, p, second))
    assert len(data) == 2 * ROWS
    assert sorted(set(data.label("tool"))) == ["1", "2"]
    assert np.isnan(data.position).all(axis=1).sum() == 1
    same(data.subset(data.label("tool") == "1"))


def test_programs_of_controllers_and_a_trackers_points_are_joined(tmp_path: Path) -> None:
    _, q, p = measured()
    kept = [k for k in range(ROWS) if k != 4]
    points = write(tmp_path / "p.txt", ["Point\tX\tY\tZ"], [f"p{k + 1}" for k in kept], p[kept], separator="\t")
    forms: dict[str, Callable[[int, Array], str]] = {
        "cal.mod": lambda k, v: f"CONST jointtarget p{k + 1}:=[[{','.join(map(str, v))}],[9E9,9E9,9E9,9E9,9E9,9E9]];",
        "cal.dat": lambda k, v: f"E6AXIS p{k + 1}={{{','.join(f'A{i} {x}' for i, x in enumerate(v, 1))},E1 0.0}}",
        "cal.ls": lambda k, v: (
            f"P[{k + 1}]{{\n UT : 1,\n {', '.join(f'J{i}= {x} deg' for i, x in enumerate(v, 1))}\n}};"
        ),
    }
    for name, form in forms.items():
        (tmp_path / name).write_text("\n".join(form(k, v) for k, v in enumerate(q.tolist())))
        data, found = read(tmp_path / name, points)
        same(data, kept)
        assert not found.doubts


def test_rows_without_names_are_joined_by_the_nearest_pose(tmp_path: Path) -> None:
    _, q, p = measured()
    kept = [k for k in range(ROWS) if k not in (12, 17)]
    joints, points = write(tmp_path / "q.csv", [], q), write(tmp_path / "p.csv", [], p[kept])
    data, found = read(joints, points)
    same(data, kept)
    assert found.map.join == "rows 1-12 = 1-12, 14-17 = 13-16, 19-30 = 17-28"
    sheet, _ = guess_files((joints, points), measured()[0], None)
    assert "rows of q.csv without a partner: 13, 18" in sheet.said


def test_two_sheets_of_a_book_are_joined_and_a_line_of_means_is_no_pose(tmp_path: Path) -> None:
    pytest.importorskip("openpyxl")
    _, q, p = measured()
    means = ["mean", "", "", *p.mean(axis=0)]
    with pd.ExcelWriter(tmp_path / "book.xlsx") as book:
        pd.DataFrame(q, columns=numbered("J{} [deg]")).to_excel(book, sheet_name="joints", index=False)
        rows = [["No", "", "", *"XYZ"], *([f"p{k}", "", "", *v] for k, v in enumerate(p)), means]
        pd.DataFrame(rows).to_excel(book, sheet_name="points", index=False, header=False)
    data, found = read(tmp_path / "book.xlsx")
    same(data)
    assert found.map.join


def test_rows_are_joined_by_the_nearest_time(tmp_path: Path) -> None:
    _, q, p = measured()
    stamps = [f"03.02.2024 10:{k:02}:00" for k in range(ROWS)]
    late = [f"10:{k:02}:00.4" for k in range(2, ROWS)]
    joints = write(tmp_path / "q.csv", [",".join(["when", *numbered("J{}")])], stamps, q)
    data, found = read(joints, write(tmp_path / "p.csv", ["clock,X,Y,Z"], late, p[2:]))
    same(data, range(2, ROWS))
    assert found.map.join == "time c1 = c1"


def text_of(*blocks: object, head: Sequence[str]) -> Callable[[Path], Path]:
    return lambda folder: write(folder / "t.csv", [",".join(head)], *blocks)


def refused() -> dict[str, tuple[Callable[[Path], Path], str]]:
    arm, q, p = measured()
    own = np.round(1e3 * flange(arm, np.radians(q))[:, :3, 3], 3)
    names = [*numbered("J{}"), "x", "y", "z"]
    other = np.roll(p, 3, axis=0)
    return {
        "positions of the controller": (text_of(q, own, head=names), "are computed by the controller"),
        "rows of other poses": (text_of(q, other, head=names), "by any unit, sign or coupling"),
        "a joint is missing": (text_of(q[:, :5], p, head=names[1:]), "8 columns of numbers; expected 6 joint values"),
        "five rows": (text_of(q[:5], p[:5], head=names), "5 rows; expected at least 6"),
    }


@pytest.mark.parametrize(
    "case",
    [
        "positions of the controller",
        pytest.param("rows of other poses", marks=pytest.mark.long),
        "a joint is missing",
        "five rows",
    ],
)
def test_what_fits_nothing_is_refused_with_the_reason(case: str, tmp_path: Path) -> None:
    make, said = refused()[case]
    with pytest.raises(InputError, match=said):
        guess_files((make(tmp_path),), measured()[0], None)


def doubtful() -> dict[str, tuple[Callable[[Path], Path], str]]:
    _, q, p = measured()
    near = np.round(q + 1e-2 * np.random.default_rng(2).normal(size=q.shape), 4)
    swapped = [*numbered("J{}"), "x", "y", "z"]
    swapped[1], swapped[2] = swapped[2], swapped[1]
    return {
        "two sets of joints": (
            text_of(q, near, p, head=[*numbered("J{}"), *numbered("axis {}"), *"xyz"]), "the encoder values only"),
        "a unit against the header": (
            text_of(q, p, head=[*numbered("J{} [rad]"), "x", "y", "z"]), "fits as [deg], but the header has [rad]"),
        "joints swapped": (text_of(q, p, head=swapped), "look swapped, which contradicts the names"),
        "x and y exchanged": (
            text_of(q, p[:, [1, 0, 2]], head=[*numbered("J{}"), *"xyz"]), "fit as well if two of the columns"),
        "signs and zeros of KUKA": (
            text_of(q * (-1, 1, 1, -1, 1, -1) + (0, -90, 90, 0, 0, 0), p, head=[*numbered("A{}"), *"xyz"]),
            "opposite signs of 'J1', 'J4' and 'J6' are inferred"),
    }  # fmt: skip


DOUBTS = (
    "two sets of joints",
    "a unit against the header",
    "joints swapped",
    "x and y exchanged",
    "signs and zeros of KUKA",
)


@pytest.mark.parametrize("case", some(DOUBTS, "a unit against the header"))
def test_a_doubt_that_matters_is_named(case: str, tmp_path: Path) -> None:
    make, said = doubtful()[case]
    _, found = guess_files((make(tmp_path),), measured()[0], None)
    assert any(said in doubt for doubt in found.doubts), found.doubts


def test_a_doubt_is_refused_where_nobody_can_be_asked(tmp_path: Path) -> None:
    make, said = doubtful()["a unit against the header"]
    file, out = make(tmp_path), tmp_path / "out.csv"
    words = ["import", file, "--mechanism", "irb6400r", "--guess", "--out", out]
    done = run(*words)
    assert done.exit_code == 2
    assert said in done.stderr
    assert not out.exists()
    assert run(*words, "--yes").exit_code == 0
    again = run("import", file, "--map", tmp_path / "out.map.toml", "--out", out)
    assert again.exit_code == 0, again.stderr
    assert "or try gpmodel import FILE --guess" in run("check", file, "--mechanism", "irb6400r").stderr
