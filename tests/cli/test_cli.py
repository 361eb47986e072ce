"""Test the commands, their exit statuses and their files."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import numpy as np
import pytest
from cli_cases import one_line, run, table, write

from gpmodel.cli import main as cli
from gpmodel.errors import GpModelError, InputError
from gpmodel.families.catalogue import catalogue
from gpmodel.files import to_json, write_text

OURS = ["check", "calibrate", "predict", "compensate", "simulate", "poses"]


def test_help_lists_every_command() -> None:
    result = run("--help")
    assert result.exit_code == 0
    for name in cli.COMMANDS:
        assert f"\n  {name} " in result.stdout


def test_no_arguments_show_the_help() -> None:
    assert run().stdout == run("--help").stdout


def test_the_package_runs_as_the_program_does() -> None:
    done = subprocess.run([sys.executable, "-m", "gpmodel", "--help"], capture_output=True, text=True, check=True)
    assert done.stdout.split() == run("--help").stdout.split()


def test_help_imports_no_numbers() -> None:
    code = "import sys; from gpmodel.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
    code += "print(sorted({'numpy', 'pandas', 'pint', 'pinocchio', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("name", sorted({*cli.COMMANDS} - {"completion"}))
def test_every_command_has_help_out_and_a_seed(name: str) -> None:
    result = run(name, "--help")
    assert result.exit_code == 0
    assert all(result.stdout.count(f"  {option} ") == 1 for option in ("--out", "--seed"))
    assert ("--quiet" in result.stdout) == (name != "effects")


def test_the_families_of_effects_are_listed_with_source_inputs_and_an_example() -> None:
    shown = run("effects", "--mechanism", "irb6400r").stdout
    for family in catalogue:
        assert f"\n{family.name}\n" in f"\n{shown}"
    assert "reading torque_J2; --effect 'joint compliance, J2'" in " ".join(shown.split())
    none = [block.split("\n")[0] for block in re.split(r"\n(?=\S)", shown) if "required: other joints" in block]
    assert none == ["linear_axis", "cyclic_error", "ball_lobes", "support_sag", "preload"]
    assert max(map(len, shown.splitlines())) <= 80


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_shell_is_told_how_to_complete(shell: str) -> None:
    assert "_GPMODEL_COMPLETE" in run("completion", shell).stdout


@pytest.mark.parametrize("name", OURS)
def test_usage_errors_are_one_line(name: str) -> None:
    assert f"gpmodel {name} --help" in one_line(run(name, "--no-such-option"), 2)


def test_unknown_command_is_one_line() -> None:
    assert "No such command 'colour'" in one_line(run("colour"), 2)
    assert "did you mean discover?" in one_line(run("discove"), 2)


def test_one_blas_thread_is_the_default() -> None:
    bare = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")} | {"MPLBACKEND": "x"}
    names = "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MPLBACKEND"
    code = f"import gpmodel.cli.main, os; print(*map(os.environ.get, {names}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=bare)
    assert done.stdout.split() == ["1", "1", "agg"]


FAILURES: list[tuple[BaseException, int, str]] = [
    (InputError("column 'x': wrong"), 2, "gpmodel: column 'x': wrong"),
    (GpModelError("two\nlines"), 2, "gpmodel: two lines"),
    (OSError(28, "No space left on device", "report.json"), 2, "No space left on device"),
    (KeyboardInterrupt(), 130, "interrupted"),
    (click.Abort(), 130, "interrupted"),
    (KeyError("theta"), 1, "a defect of gpmodel"),
    (ZeroDivisionError("no\nreason"), 1, "ZeroDivisionError: no reason"),
]


@pytest.mark.parametrize(("error", "status", "said"), FAILURES)
def test_every_error_is_one_line_and_a_status(
    error: BaseException, status: int, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    @click.command()
    def broken() -> None:
        raise error

    monkeypatch.setattr(cli.CommandGroup, "get_command", lambda self, ctx, name: broken)
    assert said in one_line(run("check"), status)
    shown = run("--debug", "check")
    assert shown.exit_code == status
    assert ("Traceback" in shown.stderr) == (status != 130)


@pytest.mark.long
def test_calibrate_reports_what_the_contract_promises(tmp_path: Path) -> None:
    frame = table(60, effects=("base_compliance=3e-7",))
    path, out = write(frame, tmp_path / "measured.csv"), tmp_path / "deep" / "out"
    result = run("calibrate", path, "--mechanism", "irb6400r", "--effect", "base_compliance", "--out", out)
    assert result.exit_code == 0, result.stderr
    assert "base compliance" in result.stdout
    report = json.loads((out / "report.json").read_text())
    assert {"schema", "command", "versions", "seed", "data", "mechanism", "ladder", "effects", "verdict"} <= set(report)
    assert report["data"]["train"] + report["data"]["heldout"] == 60
    assert [rung["step"] for rung in report["ladder"]] == ["registration", "standard", "base_compliance"]
    errors = [rung["heldout"]["rms_mm"] for rung in report["ladder"]]
    assert errors[0] > 2 * errors[1] > 10 * errors[2]
    assert errors[2] < 0.1
    (effect,) = report["effects"]
    assert effect["value"] == pytest.approx(3e-7, abs=4 * effect["stderr"])
    assert effect["inputs"] == ["moment_base_x", "moment_base_y"]
    assert sorted(p.name for p in out.iterdir()) == [
        "calibrated.urdf",
        "explore.html",
        "exports",
        "figures",
        "model.json",
        "poses.csv",
        "report.html",
        "report.json",
    ]


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_same_seed_gives_the_same_numbers(tmp_path: Path) -> None:
    path = write(table(), tmp_path / "measured.csv")
    reports = []
    for i in range(2):
        result = run(
            "calibrate",
            path,
            "--mechanism",
            "irb6400r",
            "--seed",
            5,
            "--quiet",
            "--out",
            tmp_path / str(i),
        )
        assert result.stdout == ""
        reports.append(json.loads((tmp_path / str(i) / "report.json").read_text()))
        del reports[-1]["seconds"], reports[-1]["command"]
    assert reports[0] == reports[1]


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_nothing_is_held_out_with_a_holdout_of_zero(tmp_path: Path) -> None:
    path = write(table(), tmp_path / "measured.csv")
    result = run(
        "calibrate", path, "--mechanism", "irb6400r", "--holdout", 0, "--standard", "none", "--out", tmp_path / "o"
    )
    assert result.exit_code == 0, result.stderr
    report = json.loads((tmp_path / "o" / "report.json").read_text())
    assert report["data"]["heldout"] == 0
    assert report["ladder"][0]["heldout"]["rms_mm"] is None
    assert report["parameters"] == []


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_predict_takes_the_end_of_the_session_and_says_so(tmp_path: Path) -> None:
    path = write(table(60, effects=("J1.moving:Rz:row=3e-5",)), tmp_path / "t.csv")
    for effect, said in (("J1.moving:Rz:row", 1), ("gear_ratio J3", 0)):
        out = tmp_path / str(said)
        assert run("calibrate", path, "--mechanism", "irb6400r", "--effect", effect, "--out", out).exit_code == 0
        other, same = (run("predict", out / "model.json", path, *more) for more in ((), ("--session",)))
        assert other.stderr.count("predicted for the end of the fitted session") == said
        assert same.stderr.count("row k of this table is treated as row k") == said
        assert (other.stdout != same.stdout) == bool(said)
        assert run("predict", out / "model.json", path, "--quiet").stderr == ""


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_predict_keeps_the_table_and_adds_the_prediction(tmp_path: Path) -> None:
    frame = table(30)
    path = write(frame.assign(note="as found"), tmp_path / "measured.csv")
    assert run("calibrate", path, "--mechanism", "irb6400r", "--quiet", "--out", tmp_path / "o").exit_code == 0
    joints = write(frame[[f"J{i} [deg]" for i in range(1, 7)]].assign(who="me"), tmp_path / "poses.csv")
    result = run("predict", tmp_path / "o" / "model.json", joints)
    header, first, *_ = result.stdout.splitlines()
    added = ["x [mm]", "y [mm]", "z [mm]", "sigma [mm]", "outside"]
    assert header == ",".join([*(f"J{i} [deg]" for i in range(1, 7)), "who", *added])
    predicted = np.array(first.split(",")[-5:-2], dtype=float)
    assert 0.0 < float(first.split(",")[-2]) < 0.3
    measured = frame[["x [mm]", "y [mm]", "z [mm]"]].astype(float).to_numpy()[0]
    assert np.linalg.norm(predicted - measured) < 0.3
    beside = run("predict", tmp_path / "o" / "model.json", path, "--out", tmp_path / "o")
    assert "30 poses predicted" in beside.stdout
    assert (
        (tmp_path / "o" / "predicted.csv")
        .read_text()
        .splitlines()[0]
        .endswith("note,predicted_x [mm],predicted_y [mm],predicted_z [mm],sigma [mm],outside")
    )


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.json"
    write_text(path, "one")
    write_text(path, "two")
    assert path.read_text() == "two"
    assert [p.name for p in path.parent.iterdir()] == ["a.json"]
    with pytest.raises(InputError, match="cannot be written"):
        write_text(path / "below", "three")


def test_json_has_no_nan() -> None:
    text = to_json(
        {"a": np.nan, "b": np.float64(1.5), "c": np.array([1, 2]), "d": (np.inf, None, True), "e": np.int64(3)}
    )
    assert json.loads(text) == {"a": None, "b": 1.5, "c": [1, 2], "d": [None, None, True], "e": 3}
