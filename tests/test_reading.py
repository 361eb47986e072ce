"""Test that devices, pipes and too large files are refused without being read."""

import os
import threading
from pathlib import Path

import pytest
from cli_cases import one_line, run, table, write

from gpmodel.errors import InputError
from gpmodel.texts import read_limited, read_toml

WANTED = "not a regular file"


def endless(kind: str, path: Path) -> Path:
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    return path


@pytest.mark.parametrize("kind", ["device", "pipe"])
@pytest.mark.parametrize("ending", ["table.csv", "arm.urdf", "arm.toml", "model.json"])
def test_what_never_ends_is_refused_at_once(kind: str, ending: str, tmp_path: Path) -> None:
    path = endless(kind, tmp_path / ending)
    good = write(table(40), tmp_path / "good.csv")
    arguments = {
        "table.csv": ("check", path, "--mechanism", "irb6400r"),
        "model.json": ("predict", path, good),
    }.get(ending, ("check", good, "--mechanism", path))
    said: list[str] = []
    thread = threading.Thread(target=lambda: said.append(run(*arguments).stderr), daemon=True)
    thread.start()
    thread.join(30)
    assert said, "it is still reading"
    assert WANTED in said[0]
    assert len(said[0].splitlines()) == 1


def test_no_more_is_read_than_the_limit(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(b"x" * 2000)
    assert read_limited(tmp_path / "large", 2000, "a table") == b"x" * 2000
    with pytest.raises(InputError, match="expected a table"):
        read_limited(tmp_path / "large", 1999, "a table")
    assert "Is a directory" in one_line(run("check", tmp_path, "--mechanism", "irb6400r"), 2)


def test_the_mark_that_some_editors_begin_a_file_with_is_none_of_it(tmp_path: Path) -> None:
    (tmp_path / "arm.toml").write_text("a = 1\n", encoding="utf-8-sig")
    assert read_toml(tmp_path / "arm.toml", "a table") == {"a": 1}
