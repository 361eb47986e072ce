"""Files of other programs, and of instruments, that hold what no machine or camera has: one line, nothing written."""

from pathlib import Path

import pytest
from cli_cases import one_line, run

from gpmodel.errors import InputError
from gpmodel.model.described import boards_of, cameras_of, features_of
from gpmodel.model.pixel import WORLD

SIX = "[0, 0, 0, 0, 0, 0]"
NOMINAL = f"a = {SIX}\nd = {SIX}\nalpha = {SIX}\n"
DELTA = f"delta_theta = {SIX}\ndelta_a = {SIX}\ndelta_d = {SIX}\ndelta_alpha = {SIX}\n"
URDF = """<robot name="r"><link name="a"/><link name="b"/><joint name="turn" type="revolute"><parent link="a"/>
<child link="b"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
LENS = "distortion_coefficients: [{bent}, 0, 0, 0, 0]\ncamera_matrix: [{focal}, 0, 320, 0, 900, 240, 0, 0, 1]\n"
CORNERS = "board_width: 2\nboard_height: 2\nimage_points: [1, 2, 3, 4, 5, 6, 7, 8]\n"
MAP = '[columns]\nJ1 = "a [deg]"\n'
TURNED = '[orientation]\ncolumns = ["a", "a", "a", "b"]\nconvention = "quaternion xyzw"\n'
JOINTS = "J1 [deg]\n7\n"

IMPORTS: dict[str, tuple[dict[str, str], tuple[str, ...], str]] = {
    "a link of 5 km": (
        {"f.conf": DELTA.replace("delta_a = [0", "delta_a = [5000"), "n.conf": NOMINAL},
        ("--nominal", "n.conf"),
        "f.conf: delta_a is [5000, 0, 0, 0, 0, 0]; expected 6 numbers of at most 1000 m or rad",
    ),
    "a nominal link of 1e300": (
        {"f.conf": DELTA, "n.conf": NOMINAL.replace("d = [0", "d = [1e300", 1)},
        ("--nominal", "n.conf"),
        "n.conf: d is [1e300, 0, 0, 0, 0, 0]",
    ),
    "an offset of 1e300": (
        {"f.yaml": "turn: 1e300\n", "n.urdf": URDF},
        ("--nominal", "n.urdf"),
        "f.yaml, line 1: 'turn: 1e300'; expected robot_calibration's offsets",
    ),
    "offsets to no URDF": (
        {"f.yaml": "turn: 1\n", "n.urdf": "<x/>"},
        ("--nominal", "n.urdf"),
        "the root element is <x>",
    ),
    "a focal length below zero": ({"f.yaml": LENS.format(focal=-9, bent=0)}, (), "focal_px is [-9.0, 900.0], expected"),
    "a focal length of 1e300": ({"f.yaml": LENS.format(focal="1.0e+300", bent=0)}, (), "expected at most 100000 px"),
    "a distortion of 1e300": (
        {"f.yaml": LENS.format(focal=9, bent="1.0e+300")},
        (),
        "expected at most 5 numbers up to",
    ),
    "squares of 5 km": (
        {"f.yaml": CORNERS, "j.csv": JOINTS},
        ("--joints", "j.csv", "--square", "5km"),
        "--square: 5km, expected at most 1000 m",
    ),
    "squares of less than nothing": (
        {"f.yaml": CORNERS, "j.csv": JOINTS},
        ("--joints", "j.csv", "--square=-24mm"),
        "--square: -24mm, expected more than zero",
    ),
    "joints without unit": (
        {"f.yaml": CORNERS, "j.csv": "J1\n7\n"},
        ("--joints", "j.csv", "--square", "24mm"),
        "j.csv, column 'J1': no unit; write for example 'J1 [deg]'",
    ),
    "a quotient of zero": (
        {"f.txt": "a,b\n1,2\n", "m.toml": MAP.replace('"a', '"b/(a - 1)')},
        ("--map", "m.toml"),
        "m.toml: J1: 'b/(a - 1)' is inf in row 1, expected a measured value",
    ),
    "a quaternion of nothing": (
        {"f.txt": "a,b\n0,0\n", "m.toml": MAP + TURNED},
        ("--map", "m.toml"),
        "row 1: quaternion of norm 0, expected 1",
    ),
    "a guess without a mechanism": ({"f.txt": "a,b\n1,2\n"}, ("--guess",), "--guess: needs --mechanism M"),
    "a guess of nothing": (
        {"f.txt": "a,b\n1,2\n"},
        ("--guess", "--mechanism", "irb6400r"),
        "2 columns of numbers; expected 6 joint values",
    ),
    "two files without a way": ({"f.txt": "a,b\n1,2\n"}, ("f.txt",), "f.txt: a second file; expected --guess or --map"),
    "an option that is not read": (
        {"f.txt": "a,b\n1,2\n", "m.toml": MAP},
        ("--map", "m.toml", "--square", "24mm"),
        "--square: says nothing of f.txt; leave it away",
    ),
}


@pytest.mark.parametrize("case", IMPORTS)
def test_a_bad_import_is_one_line_and_writes_nothing(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files, options, said = IMPORTS[case]
    if any(name.endswith(".yaml") for name in files):
        pytest.importorskip("yaml")
    monkeypatch.chdir(tmp_path)
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    assert said in one_line(run("import", next(iter(files)), *options, "--out", "made.txt"), 2)
    assert {path.name for path in tmp_path.iterdir()} == set(files)


BOARD = {"columns": 5, "rows": 4, "pitch_mm": 20.0}
DESCRIBED = {
    "no focal length": ("cameras", {"camera": {"C": {"focal_px": [0.0, 0.0]}}}, "expected more than zero"),
    "a distortion of nan": ("cameras", {"camera": {"C": {"distortion": [float("nan")]}}}, "expected at most 5 numbers"),
    "a board of nothing": ("board", {"board": {"B": BOARD | {"pitch_mm": 0.0}}}, "expected pitch_mm above zero"),
    "a board without rows": (
        "board",
        {"board": {"B": {"columns": 5, "pitch_mm": 30}}},
        "rows is missing; expected one",
    ),
    "a board beyond count": ("board", {"board": {"B": BOARD | {"columns": 10**9}}}, "columns and rows from 2 to 1000"),
    "a plane that looks nowhere": ("surfaces", {"plane": {"P": {"normal": [0, 0, 0]}}}, "normal is [0.0, 0.0, 0.0]"),
    "a line to nowhere": ("surfaces", {"line": {"L": {"direction": [0, 0, 0]}}}, "direction is [0.0, 0.0, 0.0]"),
    "a sphere below zero": ("surfaces", {"sphere": {"S": {"diameter_mm": -5}}}, "diameter is -5 mm, expected zero or"),
    "a probe below zero": ("surfaces", {"probe_diameter_mm": -5}, "probe_diameter is -5 mm, expected zero or more"),
}


@pytest.mark.parametrize("case", DESCRIBED)
def test_what_no_instrument_is_is_refused(case: str) -> None:
    name, content, said = DESCRIBED[case]
    reads = {"cameras": lambda c: cameras_of(c, lambda *_: WORLD), "board": lambda c: boards_of(c, lambda *_: WORLD)}
    with pytest.raises(InputError) as caught:
        reads.get(name, features_of)(content)
    assert said in str(caught.value)
