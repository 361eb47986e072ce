"""Test that `--resume DIR` continues a killed or interrupted search to equal numbers."""

import errno
import os
import random
import shutil
import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from cli_cases import one_line, run
from durable_cases import OPTIONS, begun, results, resume, start

from gpmodel.records.unfinished import FOLDER, REQUEST

WRITES = 40
"""At least so many times a search touches the disk, one way or another."""


pytestmark = pytest.mark.usefixtures("quick")


@pytest.fixture(scope="module")
def whole(cell: Path) -> tuple[dict[str, Any], float]:
    """The results of a search that nobody disturbed, and the seconds it took after its first line."""
    process = begun(cell, cell.parent / "whole")
    assert process.stderr is not None
    process.stderr.readline()
    started = time.monotonic()
    process.communicate()
    assert process.returncode == 0
    return results(cell.parent / "whole"), time.monotonic() - started


@pytest.mark.long
def test_killed_at_random_moments_it_goes_on_to_the_same_numbers(
    cell: Path, whole: tuple[dict[str, Any], float], tmp_path: Path, pytestconfig: pytest.Config
) -> None:
    expected, seconds = whole
    wanted, out = pytestconfig.getoption("--kills"), tmp_path / "out"
    moments, process, kills = random.Random(wanted), begun(cell, out), 0
    while kills < wanted:
        assert process.stderr is not None
        if process.stderr.readline():
            time.sleep(moments.uniform(0.0, seconds))
        else:
            process.wait()
        process.kill()
        process.communicate()
        if process.returncode == 0:
            assert results(out) == expected
            shutil.rmtree(out)
            process = begun(cell, out)
            continue
        assert process.returncode == -signal.SIGKILL
        kills += 1
        print(f"{kills} of {wanted} kills", flush=True)
        process = start("discover", "--resume", out)
    process.kill()
    process.communicate()
    resume(out)
    assert results(out) == expected


@pytest.mark.long
@pytest.mark.parametrize("write", [9, *(pytest.param(n, marks=pytest.mark.slow) for n in range(1, WRITES))])
def test_killed_in_the_midst_of_a_write_it_goes_on_to_the_same_numbers(
    write: int, cell: Path, whole: tuple[dict[str, Any], float], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    process = begun(cell, out, killed_at_write=write)
    _, said = process.communicate()
    if not said and process.returncode == -signal.SIGKILL:
        assert not (out / FOLDER / REQUEST).exists()
        process = begun(cell, out)
        process.communicate()
        assert process.returncode == 0
    else:
        assert process.returncode == -signal.SIGKILL
        resume(out)
    assert results(out) == whole[0]
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@contextmanager
def full_after(writes: int) -> Iterator[None]:
    """A disk on which only so many more things can be done."""
    left = writes

    def counted(function: Any) -> Any:
        def call(*arguments: Any, **named: Any) -> Any:
            nonlocal left
            left -= 1
            if left < 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return function(*arguments, **named)

        return call

    with mock.patch.multiple(os, replace=counted(os.replace), fsync=counted(os.fsync)), mock.patch.multiple(
        tempfile, mkstemp=counted(tempfile.mkstemp), mkdtemp=counted(tempfile.mkdtemp)
    ):  # fmt: skip
        yield


@pytest.mark.long
@pytest.mark.parametrize("places", [range(0, 20, 5), pytest.param(range(20), marks=pytest.mark.slow)], ids=len)
def test_a_disk_that_fills_up_is_told_and_loses_nothing(
    places: range, cell: Path, whole: tuple[dict[str, Any], float], tmp_path: Path
) -> None:
    """Each time it gets a little further, resumed by itself; what was finished is found again."""
    out = tmp_path / "out"
    arguments: list[object] = [cell, "--mechanism", "irb6400r", *OPTIONS, "--out", out]
    for place in places:
        with full_after(place + 3):
            line = one_line(run("discover", *arguments, "--quiet"), 2)
        assert "No space left on device" in line
        assert str(out) in line
        assert "free some space" in line
        assert f"gpmodel discover --resume {out}" in line
        if (out / FOLDER / REQUEST).exists():
            arguments = ["--resume", out]
        assert not any("draft" in p.name for p in (*out.rglob("*"), *tmp_path.iterdir()))
    resume(out)
    assert results(out) == whole[0]
