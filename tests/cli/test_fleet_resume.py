"""Test that `gpmodel fleet --resume DIR` keeps finished machines and refuses different inputs."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from brief_results import brief
from cli_cases import one_line, run
from fleet_cases import two_joint_arms

from gpmodel.families.candidate import Candidate
from gpmodel.files import locked_folder
from gpmodel.hierarchy.found import MachineSearch
from gpmodel.records.unfinished import FOLDER, REQUEST

pytestmark = pytest.mark.usefixtures("brief")

MACHINES = 3
_search = MachineSearch.found


def fleet_of(out: Path) -> dict[str, Any]:
    """Every number of a fleet."""
    content = json.loads((out / "fleet.json").read_text())
    return {key: value for key, value in content.items() if key not in ("command", "sha256")}


class Searches:
    """Searches machines and counts first searches; the one after the last that is `allowed` is interrupted."""

    def __init__(self, allowed: int = MACHINES) -> None:
        self.done, self.allowed = 0, allowed

    def __call__(self, task: MachineSearch) -> tuple[Candidate, ...]:
        if self.done == self.allowed and not task.known:
            raise KeyboardInterrupt
        self.done += not task.known
        return _search(task)


def resumed(out: Path, *options: object) -> tuple[int, str]:
    """Resume in this process; return the number of machines searched, and the output."""
    searches = Searches()
    with mock.patch.object(MachineSearch, "found", lambda task: searches(task)):
        done = run("fleet", "--resume", out, "--workers", 1, *options)
    assert done.exit_code == 0, done.stderr
    return searches.done, done.stderr


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return two_joint_arms(tmp_path_factory.mktemp("fleet") / "tables", MACHINES)


@pytest.fixture(scope="module")
def expected(tables: Path) -> dict[str, Any]:
    """The numbers of a fleet that nobody disturbed."""
    out = tables.parent / "whole"
    with brief():
        assert run("fleet", tables, "--out", out, "--quiet").exit_code == 0
    assert {p.name for p in out.iterdir()} == {"fleet.html", "fleet.json", "figures", "machines"}
    return fleet_of(out)


@pytest.fixture(scope="module")
def interrupted(tables: Path) -> Path:
    """The folder of a fleet that was interrupted in its second machine, beside its tables."""
    out = tables.parent / "my fleet"
    searches = Searches(allowed=1)
    with mock.patch.object(MachineSearch, "found", lambda task: searches(task)):
        stopped = run("fleet", tables, "--out", out, "--workers", 1)
    assert stopped.exit_code == 130
    assert f"resume with: gpmodel fleet --resume '{out}'" in stopped.stderr.splitlines()[-1]
    assert {p.name for p in (out / FOLDER).iterdir()} == {REQUEST, "machine-0001.json"}
    return out


@pytest.fixture
def cut(interrupted: Path, tables: Path, tmp_path: Path) -> Path:
    """A copy of it, and of the tables beside it."""
    shutil.copytree(tables, tmp_path / "tables")
    return Path(shutil.copytree(interrupted, tmp_path / "out"))


@pytest.mark.long
def test_folders_may_move_together_and_a_damaged_file_is_done_again(
    cut: Path, expected: dict[str, Any], tmp_path: Path
) -> None:
    assert str(tmp_path) not in (cut / FOLDER / REQUEST).read_text()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    out = Path(shutil.move(cut, elsewhere / "out"))
    shutil.move(tmp_path / "tables", elsewhere / "tables")
    path = out / FOLDER / "machine-0001.json"
    path.write_text(path.read_text().replace("J2", "J1"))
    searched, said = resumed(out)
    assert searched == MACHINES
    assert "set aside as machine-0001.json.damaged" in said
    assert fleet_of(out) == expected
    again = run("fleet", "--resume", out)
    assert "nothing is left to do" in again.stdout


def grown(folder: Path) -> None:
    path = folder / "A-2.csv"
    path.write_text(path.read_text() + path.read_text().splitlines()[-1] + "\n")


def commented(folder: Path) -> None:
    path = folder / "fleet.toml"
    path.write_text(path.read_text() + "# later\n")


def described_otherwise(folder: Path) -> None:
    path = folder / "arm.toml"
    path.write_text(path.read_text().replace("500", "501"))


CHANGED: dict[str, tuple[Callable[[Path], object], list[object], str]] = {
    "table": (grown, [], "the file A-2.csv has changed."),
    "further table": (lambda f: shutil.copy(f / "A-1.csv", f / "A-9.csv"), [], "the file A-9.csv is new."),
    "table gone": (lambda f: (f / "A-3.csv").unlink(), [], "the file A-3.csv is gone."),
    "fleet.toml": (commented, [], "the file fleet.toml has changed."),
    "mechanism": (described_otherwise, [], "the mechanism has changed."),
    "folder gone": (shutil.rmtree, [], "no such folder"),
    "seed": (lambda f: None, ["--seed", 1], "--seed is 1, was 0."),
    "effect": (lambda f: None, ["--effect", "none"], "--effect is ['none'], was []."),
}


@pytest.mark.parametrize("case", CHANGED)
def test_what_changed_since_is_said_and_nothing_is_touched(case: str, cut: Path, tmp_path: Path) -> None:
    before = {p: p.read_bytes() for p in cut.rglob("*") if p.is_file()}
    change, options, said = CHANGED[case]
    change(tmp_path / "tables")
    assert said in one_line(run("fleet", "--resume", cut, *options), 2)
    assert {p: p.read_bytes() for p in cut.rglob("*") if p.is_file()} == before


def test_another_command_another_process_and_nothing_to_resume_are_one_line(cut: Path, tmp_path: Path) -> None:
    assert "the unfinished run belongs to fleet" in one_line(run("discover", "--resume", cut, "--quiet"), 2)
    with locked_folder(cut):
        assert "another gpmodel process uses this folder" in one_line(run("fleet", "--resume", cut, "--quiet"), 2)
    assert "has no unfinished search" in one_line(run("fleet", "--resume", tmp_path / "tables"), 2)
    assert "Missing argument 'DIR'" in one_line(run("fleet"), 2)
    assert "--payload" in one_line(run("fleet", tmp_path / "tables", "--payload", "3kg"), 2)
