"""Test the commands of the README in an empty folder, from a file to the report."""

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from gpmodel.cli.demo import example_files
from gpmodel.cli.main import main

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
SIX = ("check", "calibrate", "discover", "predict", "compensate", "verify")


def commands() -> list[list[str]]:
    """Return the words of the example files' command and of the six that read them."""
    made = re.search(r"`gpmodel (demo --files [^`]+)`", README)
    block = README[README.index("five example files") :].split("\n\n")[1]
    assert made is not None
    return [shlex.split(made[1]), *(shlex.split(line, comments=True)[1:] for line in block.splitlines())]


@pytest.mark.long
def test_the_six_commands_run_as_they_stand_in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    words = commands()
    assert tuple(command[0] for command in words[1:]) == SIX
    said = {}
    for command in words:
        quick = ["--runs", "0"] if command[0] == "discover" else []
        done = CliRunner().invoke(main, [*command, *quick], catch_exceptions=False)
        assert done.exit_code == 0, (command, done.output)
        said[command[0]] = done.output
    assert "fit to calibrate with; no warnings" in said["check"]
    assert "joint compliance, J2" in said["discover"]
    assert "The model holds" in said["verify"]
    assert "ok" in said["compensate"]


@pytest.mark.long
def test_an_export_and_a_description_lead_to_the_report_by_two_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    example_files(tmp_path, 0)
    head, *rows = Path("table.csv").read_text(encoding="utf-8").splitlines()
    bare = re.sub(r" \[[^]]+\]", "", head)
    export = [line.replace(",", ";").replace(".", ",") for line in (bare, *rows)]
    Path("export.txt").write_text("\n".join(["Job;cell 7", "", *export]), encoding="cp1252")
    for words in (
        "import export.txt --mechanism arm.urdf --guess --out mine.csv",
        "discover mine.csv --mechanism arm.urdf --runs 0 --out result",
    ):
        done = CliRunner().invoke(main, words.split(), catch_exceptions=False)
        assert done.exit_code == 0, (words, done.output)
    assert "joint compliance, J2" in done.output
    assert Path("result/report.html").exists()
