"""Test which parts of a search `gpmodel discover --resume DIR` keeps, and what it refuses."""

import json
import shlex
import shutil
from pathlib import Path
from unittest import mock

import pytest
from cli_cases import one_line, run
from durable_cases import OPTIONS, resume, small

from gpmodel.files import locked_folder
from gpmodel.records.unfinished import FOLDER, REQUEST
from gpmodel.texts import read_json, write_json

pytestmark = pytest.mark.usefixtures("quick")


@pytest.fixture(scope="module")
def expected(cell: Path) -> str:
    """The model of a search that nobody disturbed."""
    out = cell.parent / "whole"
    with small():
        assert run("discover", cell, "--mechanism", "irb6400r", *OPTIONS, "--out", out).exit_code == 0
    return (out / "model.json").read_text()


@pytest.fixture(scope="module")
def interrupted(cell: Path) -> Path:
    """The folder of a search that was interrupted in its first round, beside its table."""
    out = cell.parent / "interrupted"
    with mock.patch("gpmodel.discovery.loop.choose", side_effect=KeyboardInterrupt), small():
        stopped = run("discover", cell, "--mechanism", "irb6400r", *OPTIONS, "--out", out)
    assert stopped.exit_code == 130
    last = stopped.stderr.splitlines()[-1]
    assert "interrupted" in last
    assert f"gpmodel discover --resume {shlex.quote(str(out))}" in last
    assert {p.name for p in out.iterdir()} == {FOLDER}
    return out


@pytest.fixture
def cut(interrupted: Path, cell: Path, tmp_path: Path) -> Path:
    """A copy of it, and of the table beside it."""
    shutil.copy(cell, tmp_path)
    return Path(shutil.copytree(interrupted, tmp_path / "out"))


@pytest.mark.long
def test_result_and_table_may_move_together(cut: Path, expected: str, tmp_path: Path) -> None:
    assert str(tmp_path) not in (cut / FOLDER / REQUEST).read_text()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.move(cut, elsewhere / "out")
    shutil.move(tmp_path / "cell.csv", elsewhere / "cell.csv")
    resume(elsewhere / "out")
    assert (elsewhere / "out" / "model.json").read_text() == expected
    again = run("discover", "--resume", elsewhere / "out")
    assert again.exit_code == 0
    assert "nothing is left to do" in again.stdout


@pytest.mark.long
def test_a_table_that_moved_alone_is_said_again(cut: Path, tmp_path: Path) -> None:
    moved = shutil.move(tmp_path / "cell.csv", tmp_path / "moved.csv")
    assert "cell.csv: the table of this search is missing" in one_line(run("discover", "--resume", cut), 2)
    assert run("discover", moved, "--resume", cut, "--quiet").exit_code == 0


CHANGED = {
    "table": ([], "the table has changed"),
    "seed": (["--seed", "4"], "--seed is 4, was 0"),
    "runs": (["--runs", "3"], "--runs is 3, was 2"),
    "mechanism": (["--mechanism", "ur5"], "the mechanism is ur5, was irb6400r"),
    "payload": (["--mechanism", "irb6400r", "--payload", "3kg"], "--payload is 3kg, was None"),
    "out": (["--out", "elsewhere"], "--out: the results go to the folder of --resume"),
}


@pytest.mark.parametrize("case", CHANGED)
def test_what_changed_since_is_said_and_nothing_is_touched(case: str, cut: Path, tmp_path: Path) -> None:
    before = {p: p.read_bytes() for p in cut.rglob("*") if p.is_file()}
    if case == "table":
        text = (tmp_path / "cell.csv").read_text()
        (tmp_path / "cell.csv").write_text(text + text.splitlines()[-1] + "\n")
    options, said = CHANGED[case]
    assert said in one_line(run("discover", "--resume", cut, *options, "--quiet"), 2)
    assert {p: p.read_bytes() for p in cut.rglob("*") if p.is_file()} == before


@pytest.mark.long
def test_the_same_asked_again_goes_on_and_something_else_is_refused(cut: Path, expected: str, tmp_path: Path) -> None:
    arguments = [tmp_path / "cell.csv", "--mechanism", "irb6400r", *OPTIONS, "--out", cut]
    line = one_line(run("discover", *arguments, "--quiet", "--seed", 5), 2)
    assert "unfinished search has other inputs: --seed is 5, was 0" in line
    again = run("discover", *arguments)
    assert again.exit_code == 0
    assert "going on from 5 finished runs" in again.stderr
    assert (cut / "model.json").read_text() == expected


@pytest.mark.long
def test_a_damaged_run_is_named_and_done_again(cut: Path, expected: str) -> None:
    path = cut / FOLDER / "run-1-0001.json"
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"evaluations": 1}))
    done = run("discover", "--resume", cut)
    assert done.exit_code == 0
    assert "run-1-0001.json: its content is not what was written; set aside as run-1-0001.json.damaged" in done.stderr
    assert (cut / "model.json").read_text() == expected


def test_results_of_another_command_and_a_foreign_request_are_one_line(cut: Path, tmp_path: Path) -> None:
    (tmp_path / "report.json").write_text('{"kind": "calibrate"}')
    assert "has no unfinished search" in one_line(run("discover", "--resume", tmp_path), 2)
    content = read_json(cut / FOLDER / REQUEST)
    for wrong in ({}, {"command": "discover", "files": []}, content["request"] | {"options": 3}):
        write_json(cut / FOLDER / REQUEST, content | {"request": wrong})
        assert "was not written by gpmodel" in one_line(run("discover", "--resume", cut), 2)


@pytest.mark.parametrize("command", ["discover", "evolve", "fleet"])
def test_of_a_finished_search_nothing_is_left_to_do(command: str, tmp_path: Path) -> None:
    (tmp_path / ("fleet.json" if command == "fleet" else "report.json")).write_text(f'{{"kind": "gpmodel {command}"}}')
    done = run(command, "--resume", tmp_path, "--out", tmp_path, "--workers", 1, "--quiet")
    assert (done.exit_code, done.stdout.split(" in ")[0]) == (0, "nothing is left to do")


def test_files_that_options_name_move_with_the_result_and_are_part_of_what_was_asked(
    cell: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(cell, "cell.csv")
    there = tmp_path / "there"
    for path in (tmp_path / "rig" / "model.json", tmp_path / "two.toml", there / "empty"):
        path.parent.mkdir(exist_ok=True)
        path.touch()
    asked = ["cell.csv", "--mechanism", "irb6400r", "--joint", "L3.fixed=rig", "--cameras", "two.toml", "--out", "out"]
    interrupted = mock.patch("gpmodel.cli.discover.look", side_effect=KeyboardInterrupt)
    with interrupted as look, mock.patch("gpmodel.cli.discover.read_table") as read:
        assert run("discover", *asked).exit_code == 130
        for name in ("out", "cell.csv", "two.toml", "rig"):
            shutil.move(name, there)
        assert run("discover", "--resume", "there/out").exit_code == 130
    options = look.call_args.kwargs["joints"], read.call_args.kwargs["cameras"]
    assert options == (("L3.fixed=there/rig",), "there/two.toml")
    (there / "rig" / "model.json").write_text("other")
    assert "--joint L3.fixed has changed" in one_line(run("discover", "--resume", "there/out", "--quiet"), 2)
    (there / "two.toml").unlink()
    assert "there/two.toml: --cameras of this search is missing" in one_line(
        run("discover", "--resume", "there/out", "--quiet"), 2
    )


def test_two_at_once_do_not_touch_each_other(cut: Path) -> None:
    with locked_folder(cut):
        assert "another gpmodel process uses this folder" in one_line(run("discover", "--resume", cut, "--quiet"), 2)
