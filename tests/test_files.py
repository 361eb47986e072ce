"""Test that files are written whole by one process at a time, and that drafts of ended processes are deleted."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from unittest import mock

import pytest
from filelock import BaseFileLock

from gpmodel import files, texts
from gpmodel.errors import InputError, WriteError


@pytest.fixture
def dead() -> int:
    """The number of a process that is no more."""
    return int(subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True).stdout)


def test_drafts_of_dead_processes_are_swept_away_and_of_living_ones_are_not(dead: int, tmp_path: Path) -> None:
    mine = files._mine()
    gone, living = (mine.replace(f"-{os.getpid()}-", f"-{process}-") for process in (dead, os.getppid()))
    (tmp_path / f"{gone}a").write_text("half")
    (tmp_path / f"{gone}b").mkdir()
    (tmp_path / f"{gone}b" / "inside").write_text("half")
    kept = {f"{living}a", f"{mine}a", f".gpmodel-draft-elsewhere-{dead}-a", "other"}
    for name in kept:
        (tmp_path / name).write_text("half")
    files.write_text(tmp_path / "whole", "text")
    assert {p.name for p in tmp_path.iterdir()} == kept | {"whole"}


def write_both(out: Path) -> None:
    with files.finished_folder(out) as draft:
        (draft / "a").write_text("new")
        (draft / "b").write_text("new")


def test_a_folder_where_a_file_belongs_leaves_all_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "out" / "b").mkdir(parents=True)
    with pytest.raises(WriteError, match="a file and a folder have this name"):
        write_both(tmp_path / "out")
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["b"]


def half_written(out: Path) -> None:
    with files.finished_folder(out) as draft:
        (draft / "new").write_text("new")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("there", [False, True])
def test_a_folder_is_finished_or_as_it_was(there: bool, tmp_path: Path) -> None:
    out = tmp_path / "out"
    if there:
        out.mkdir()
        (out / "old").write_text("old")
    with pytest.raises(WriteError, match=r"out: cannot be written \(No space left.*free some space"):
        half_written(out)
    assert {p.name for p in tmp_path.rglob("*")} == ({"out", "old"} if there else set())
    with files.finished_folder(out) as draft:
        (draft / "new").write_text("new")
    assert {p.name for p in out.iterdir()} == ({"old", "new"} if there else {"new"})


def test_an_error_of_another_file_is_not_told_of_the_folder(tmp_path: Path) -> None:
    missing = tmp_path / "installed" / "page.js"
    with pytest.raises(FileNotFoundError, match=r"page\.js"), files.finished_folder(tmp_path / "user" / "out"):
        missing.read_text()
    assert list((tmp_path / "user").iterdir()) == []


def test_one_process_at_a_time(tmp_path: Path) -> None:
    out = tmp_path / "a" / "b"
    with (
        files.locked_folder(out),
        pytest.raises(InputError, match="another gpmodel process uses this folder"),
        files.locked_folder(out),
    ):
        pass
    assert list(tmp_path.iterdir()) == []
    with files.locked_folder(out):
        (out / "result").touch()
    assert [p.name for p in out.iterdir()] == ["result"]


def test_the_lock_of_a_killed_process_is_free(tmp_path: Path) -> None:
    code = (
        "import os, sys, pathlib, gpmodel.files as f\n"
        "with f.locked_folder(pathlib.Path(sys.argv[1])):\n"
        "    os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", code, tmp_path / "out"])
    assert (tmp_path / "out" / files.LOCK).exists()
    with files.locked_folder(tmp_path / "out"):
        pass
    assert not (tmp_path / "out" / files.LOCK).exists()


def test_the_lock_is_removed_while_it_is_held(tmp_path: Path) -> None:
    """Afterwards it may be that of another process, and a third would make a new one beside it."""
    with mock.patch.object(BaseFileLock, "release", side_effect=lambda *_: there.append(lock.exists())):
        there, lock = list[bool](), tmp_path / files.LOCK
        with files.locked_folder(tmp_path):
            assert lock.exists()
    assert there[0] is False


def test_what_cannot_be_set_aside_or_removed_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    read_only = OSError(errno.EROFS, os.strerror(errno.EROFS))
    for action in (files.mark_damaged, files.remove_folder):
        with mock.patch("os.replace", side_effect=read_only), pytest.raises(WriteError, match=r"a: .*Read-only"):
            action(tmp_path / "a")


def test_a_seal_is_of_the_content_not_of_its_layout(tmp_path: Path) -> None:
    content = {"b": [1.0, 2, None], "a": {"x": "é"}}
    assert texts.seal(content) == texts.seal({"a": {"x": "é"}, "b": [1.0, 2, None], texts.SEAL: "anything"})
    assert texts.seal(content) != texts.seal(content | {"b": [1.0, 2.5, None]})
    texts.write_json(tmp_path / "f", content)
    assert texts.read_json(tmp_path / "f") == content
    text = (tmp_path / "f").read_text()
    wrong = (text.replace("2", "3"), text.replace("null", "NaN"), text.replace("1.0", "1e999"))
    for damaged in (*wrong, "[]", "", "[" * 100_000):
        (tmp_path / "f").write_text(damaged)
        with pytest.raises(ValueError, match=r".+"):
            texts.read_json(tmp_path / "f")


def test_a_removed_folder_is_gone_from_one_moment_to_the_next(tmp_path: Path) -> None:
    (tmp_path / "out" / "deep").mkdir(parents=True)
    with mock.patch("shutil.rmtree", side_effect=KeyboardInterrupt), pytest.raises(KeyboardInterrupt):
        files.remove_folder(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_name_of_bytes_that_are_no_text_is_kept_as_an_escape(tmp_path: Path) -> None:
    files.write_text(tmp_path / "a.json", files.to_json({"command": "gpmodel o\udcff.csv"}))
    assert texts.parse_json((tmp_path / "a.json").read_bytes()) == {"command": "gpmodel o\udcff.csv"}
