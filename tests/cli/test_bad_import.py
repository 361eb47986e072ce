"""`gpmodel import` on bad files, and commands on tables of other instruments."""

from pathlib import Path

import pandas as pd
import pytest
from cli_cases import one_line, run, write
from instrument_cases import OTHERS

import gpmodel as gp
from gpmodel.errors import InputError
from gpmodel.model.described import read_boards, read_cameras, read_surfaces
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
    "a guess without a mechanism": ({"f.txt": "a,b\n1,2\n"}, ("--guess",), "--guess: needs the joints of a mechanism"),
    "a guess of nothing": (
        {"f.txt": "a,b\n1,2\n"},
        ("--guess", "--mechanism", "irb6400r"),
        "2 columns of numbers; expected 6 joint values",
    ),
    "two files without a way": ({"f.txt": "a,b\n1,2\n"}, ("f.txt",), "f.txt: a second file; expected --guess or --map"),
    "an option that is not read": (
        {"f.txt": "a,b\n1,2\n", "m.toml": MAP},
        ("--map", "m.toml", "--square", "24mm"),
        "--square: does not apply to f.txt; omit the option",
    ),
}


def test_a_missing_file_is_no_unknown_layout(tmp_path: Path) -> None:
    assert "nofile.jbi: cannot be read" in one_line(run("import", tmp_path / "nofile.jbi", "--out", "made.txt"), 2)


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
    "a plane that looks nowhere": (
        "surfaces",
        {"plane": {"P": {"normal": [0, 0, 0]}}},
        "normal is [0.0, 0.0, 0.0], expected a vector longer than zero",
    ),
    "a line to nowhere": ("surfaces", {"line": {"L": {"direction": [0, 0, 0]}}}, "direction is [0.0, 0.0, 0.0]"),
    "a sphere below zero": ("surfaces", {"sphere": {"S": {"diameter_mm": -5}}}, "diameter is -5 mm, expected zero or"),
    "a probe below zero": ("surfaces", {"probe_diameter_mm": -5}, "probe_diameter is -5 mm, expected zero or more"),
}


@pytest.mark.parametrize("case", DESCRIBED)
def test_what_no_instrument_is_is_refused(case: str) -> None:
    name, content, said = DESCRIBED[case]
    reads = {
        "cameras": lambda c: read_cameras(c, lambda *_: WORLD),
        "board": lambda c: read_boards(c, lambda *_: WORLD),
    }
    with pytest.raises(InputError) as caught:
        reads.get(name, read_surfaces)(content)
    assert said in str(caught.value)


ARM = "irb6400r"
FEW = {"camera": 10, "hand camera": 15, "bar": 48}
"""Poses, where not 30: every one has many corners, or every bar five unknowns."""
READ = {"camera": "pixel", "hand camera": "pixel", "inclinometer": "inclination"}
"""Names of readings that are no lengths, in the summary."""


def simulated(instrument: str, folder: Path) -> tuple[Path, list[object]]:
    """A table of an instrument, and the options that say what it looks at."""
    table = folder / "table.csv"
    done = run("simulate", "--mechanism", ARM, "--instrument", instrument, "--poses", FEW.get(instrument, 30),
               "--geometry-sigma", "0.3mm", "--out", table)  # fmt: skip
    assert done.exit_code == 0, done.stderr
    beside = {name: folder / f"table.{name}.toml" for name in ("cameras", "board")}
    return table, [part for name, file in beside.items() if file.exists() for part in (f"--{name}", file)]


@pytest.mark.long
@pytest.mark.parametrize("instrument", OTHERS)
def test_simulated_readings_are_checked_and_calibrated(instrument: str, tmp_path: Path) -> None:
    table, options = simulated(instrument, tmp_path)
    assert bool(options) == ("camera" in instrument)
    done = run("check", table, "--mechanism", ARM, *options)
    assert done.exit_code == 0, done.stderr
    if "camera" in instrument:
        assert f"{FEW[instrument]} poses of {ARM} in {20 * FEW[instrument]} rows" in done.stdout
    done = run("calibrate", table, "--mechanism", ARM, "--standard", "J? Rz", *options)
    assert done.exit_code == 0, done.stderr
    assert {"camera": "pixel", "hand camera": "pixel", "inclinometer": "inclination"}.get(
        instrument, "mm"
    ) in done.stdout


def test_what_is_refused_is_one_line_with_its_row(tmp_path: Path) -> None:
    table, options = simulated("camera", tmp_path)
    frame = pd.read_csv(table, dtype=str)
    said = one_line(run("check", table, "--mechanism", ARM), 2)
    assert "expected --cameras FILE.toml too" in said
    frame.loc[4, "camera"] = "D"
    said = one_line(run("check", write(frame, tmp_path / "unknown.csv"), "--mechanism", ARM, *options), 2)
    assert "row 5: camera 'D' is unknown; expected C" in said


@pytest.mark.long
def test_pixels_that_no_camera_saw_are_refused(tmp_path: Path) -> None:
    table, options = simulated("camera", tmp_path)
    good = pd.read_csv(table, dtype=str)
    crossed = {"u [px]": "v [px]", "v [px]": "u [px]"}
    for frame, said in (
        (good.rename(columns=crossed), "column 'pixel': does not fit irb6400r: the residual is "),
        (good.rename(columns={"v [px]": "w [px]"}), "no row has both u and v; expected columns 'u [px]' and 'v [px]'"),
    ):
        for command in ("check", "calibrate"):
            path = write(frame, tmp_path / "other.csv")
            assert said in one_line(run(command, path, "--mechanism", ARM, *options), 2)


@pytest.mark.long
def test_what_a_camera_cannot_show_has_no_sigma_and_its_noise_is_in_pixels(tmp_path: Path) -> None:
    path, options = simulated("camera", tmp_path)
    beside = dict(zip(("cameras", "board"), options[1::2], strict=True))
    table = gp.read_table(path, ARM, **beside)
    candidate = gp.effect_at("yields", "J2.moving", "Ry", gp.Expression("torque_J2"), "rad/Nm")
    found = gp.discover(ARM, table, search=gp.Search(runs=0), candidates=[candidate], standard=("J? Rz",),
                        noise="0.1 px", holdout=0.3)  # fmt: skip
    assert found.record.noise_floor_mm == pytest.approx(found.record.ladder[-1].train.rms_mm, rel=0.5)
    assert found.record.data.counted == "10 poses in 200 rows"
    model = gp.calibrate(ARM, table, standard=("J? Rz",), holdout=0.0).model
    assert model.predict(table)["sigma [mm]"].max() < 1.0
