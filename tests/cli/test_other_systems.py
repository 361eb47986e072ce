"""Windows and macOS: process start without fork, code pages, folders with blanks and umlauts, several drives."""

import multiprocessing
import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from cli_cases import table, write

import robots
from gpmodel import executor, files
from gpmodel.characters import PLAIN, plain
from gpmodel.cli import request

SPAWNED = """
import multiprocessing, sys
multiprocessing.set_start_method("spawn")
from gpmodel.cli.main import main
main(sys.argv[1:])
"""
FOLDER = "Ordner mit Lücke"
DESCRIPTION = Path(robots.__file__).with_name("data") / "irb6400r.toml"
TEMPORARY = ("TMPDIR", "TEMP", "TMP")


def spawned(folder: Path, *words: str) -> str:
    """Run a command where processes are spawned and the console is Windows-1252; return what it prints."""
    code_page = {"PYTHONIOENCODING": "cp1252", "PYTHONUTF8": "0", "CI": "1"}
    done = subprocess.run([sys.executable, "-c", SPAWNED, *words], cwd=folder, env=os.environ | code_page,
                          capture_output=True, encoding="cp1252", check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "?" not in done.stdout
    return done.stdout


@pytest.mark.long
def test_an_unpacked_mechanism_goes_with_its_process(tmp_path: Path) -> None:
    methods = [m for m in ("fork", "spawn") if m in multiprocessing.get_all_start_methods()]
    unpack = f"""
import multiprocessing, os
from gpmodel.mechanism.source import MechanismChoice
arm = MechanismChoice("read.toml", description={DESCRIPTION.read_text()!r})
for method in {methods!r}:
    other = multiprocessing.get_context(method).Process(target=arm.load)
    other.start(), other.join()
    print(other.exitcode, len(os.listdir({str(tmp_path)!r})))
arm.load()
print(len(os.listdir({str(tmp_path)!r})))
"""
    done = subprocess.run([sys.executable, "-c", unpack], env=os.environ | dict.fromkeys(TEMPORARY, str(tmp_path)),
                          capture_output=True, text=True, check=False)  # fmt: skip
    assert done.stdout.split() == [*["0", "0"] * len(methods), "1"], done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / FOLDER).mkdir()
    write(table(40, effects=("joint_compliance J2=2e-6",)), tmp_path / FOLDER / "Meßwerte Ü.csv")
    return tmp_path / FOLDER


@pytest.mark.long
def test_a_table_is_judged_in_a_code_page(folder: Path) -> None:
    assert "fit to calibrate with" in spawned(folder, "check", "Meßwerte Ü.csv", "--mechanism", "irb6400r")


@pytest.mark.long
@pytest.mark.parametrize("options", ["calibrate --effect 'joint_compliance J2'", "discover --runs 0 --workers 2"])
def test_a_result_is_made_where_processes_are_spawned(options: str, folder: Path) -> None:
    command, *words = shlex.split(options)
    out = "Ergebnis für zwei"
    said = spawned(folder, command, "Meßwerte Ü.csv", "--mechanism", "irb6400r", "--out", out, *words)
    assert f"gpmodel explain {shlex.quote(out)} 1" in said
    assert "joint compliance, J2" in spawned(folder, "explain", out, "1")
    assert (folder / out / "report.html").exists()


def test_the_demo_is_found_on_another_drive(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def on_another_drive(path: Path, start: Path) -> str:
        raise ValueError("path is on mount 'C:', start on mount 'D:'")

    monkeypatch.setattr(os.path, "relpath", on_another_drive)
    assert request._relative(tmp_path / "a.csv", tmp_path / "out") == (tmp_path / "a.csv").as_posix()


@pytest.mark.parametrize(("method", "copied"), [(None, True), ("fork", True), ("spawn", False), ("forkserver", False)])
def test_processes_are_copied_only_where_the_start_method_is_fork(
    method: str | None, copied: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("multiprocessing.get_start_method", lambda allow_none: method)
    monkeypatch.setattr("threading.active_count", lambda: 1)
    monkeypatch.setattr(sys, "platform", "linux")
    assert executor._copies() == copied


def test_a_folder_is_put_aside_where_no_folder_replaces_another(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    replaced = os.replace

    def as_on_windows(one: Path, other: Path) -> None:
        if Path(other).is_dir():
            raise PermissionError(13, "Access is denied", str(one))
        replaced(one, other)

    monkeypatch.setattr(os, "replace", as_on_windows)
    (tmp_path / "parts").mkdir()
    files.remove_folder(tmp_path / "parts")
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "ascii_text", "code_page"),
    [
        ("tool y  −97.5 ± 0.3 mm", "tool y  -97.5 +/- 0.3 mm", "tool y  -97.5 ± 0.3 mm"),
        ("40.9 ×10⁻⁶", "40.9 x10^-6", "40.9 ×10^-6"),
        ("10⁻¹² m²", "10^-12 m^2", "10^-¹² m²"),
        ("σ, Σ → µrad/(N·m), 20 °C", "sigma, Sigma -> urad/(N*m), 20 degC", "sigma, Sigma -> µrad/(N·m), 20 °C"),
        ("1.139\u202f→\u00a00.046 ≤ ½", "1.139 -> 0.046 <= 1/2", "1.139 ->\u00a00.046 <= ½"),
        ("Lücke ß 你", "Lucke ss ?", "Lücke ß ?"),
    ],
)
def test_no_sign_and_no_power_is_lost_in_a_code_page(text: str, ascii_text: str, code_page: str) -> None:
    assert text.encode("ascii", PLAIN).decode() == plain(text) == ascii_text
    assert text.encode("cp1252", PLAIN).decode("cp1252") == code_page
