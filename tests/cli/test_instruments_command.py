"""Every instrument by the command line: simulate, check, calibrate; and what is refused there."""

from pathlib import Path

import pandas as pd
import pytest
from cli_cases import one_line, run, write
from instrument_cases import OTHERS

import gpmodel as gp

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
    assert "expected --cameras FILE.toml beside them" in said
    few = write(frame.drop(index=range(3, 20)), tmp_path / "few.csv")
    said = one_line(run("calibrate", few, "--mechanism", ARM, *options), 2)
    assert "row 1: camera 'C' sees 3 corners in one pose; expected at least 4" in said
    frame.loc[4, "camera"] = "D"
    said = one_line(run("check", write(frame, tmp_path / "unknown.csv"), "--mechanism", ARM, *options), 2)
    assert "row 5: camera 'D' is unknown; expected C" in said


@pytest.mark.long
def test_pixels_that_no_camera_saw_are_refused(tmp_path: Path) -> None:
    table, options = simulated("camera", tmp_path)
    good = pd.read_csv(table, dtype=str)
    crossed = {"u [px]": "v [px]", "v [px]": "u [px]"}
    for frame, said in (
        (good.rename(columns=crossed), "column 'pixel': does not fit irb6400r, "),
        (good.rename(columns={"v [px]": "w [px]"}), "no row has both u and v; expected columns 'u [px]' and 'v [px]'"),
    ):
        for command in ("check", "calibrate"):
            path = write(frame, tmp_path / "other.csv")
            assert said in one_line(run(command, path, "--mechanism", ARM, *options), 2)


@pytest.mark.long
def test_touches_that_say_too_little_are_refused(tmp_path: Path) -> None:
    table, _ = simulated("points", tmp_path)
    frame = pd.read_csv(table, dtype=str)
    frame.loc[5, "same_point"] = "alone"
    said = one_line(run("check", write(frame, tmp_path / "alone.csv"), "--mechanism", ARM), 2)
    assert "row 6: 'alone' has one touch; expected at least 2" in said
    table, _ = simulated("planes", tmp_path)
    frame = pd.read_csv(table, dtype=str)
    touched = frame.index[frame["on_plane"] == "A"]
    first = [c for c in frame.columns if "[deg]" in c]
    frame.loc[touched, first] = frame.loc[touched[0], first].to_numpy()
    frame.loc[touched, first[0]] = [str(0.01 * k) for k in range(len(touched))]
    said = one_line(run("calibrate", write(frame, tmp_path / "line.csv"), "--mechanism", ARM), 2)
    assert "on_plane A: touched along a line; expected touches spread over the plane" in said


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
