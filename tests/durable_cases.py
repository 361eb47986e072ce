"""Run a small search in a process that is stopped during writing or killed from outside."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import pandas as pd
from brief_results import brief
from cli_cases import run, table, write

from gpmodel.cli import discover
from gpmodel.discovery.search import Search

DRIVER = """
import os, signal, sys, tempfile
from functools import partial
from brief_results import brief
from gpmodel.cli import discover, main
from gpmodel.discovery.search import Search
discover.Search = partial(Search, population=48, generations=4, climb=0)
left = int(os.environ.get("KILLED_AT_WRITE", 0))
def counted(function):
    def call(*arguments, **named):
        global left
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*arguments, **named)
    return call
if left:
    os.replace, os.fsync, tempfile.mkstemp = map(counted, (os.replace, os.fsync, tempfile.mkstemp))
with brief():
    main.main(sys.argv[1:])
"""
OPTIONS = ("--runs", "2", "--noise", "0.03mm", "--workers", "2", "--holdout", "0.3")


def measured(folder: Path) -> Path:
    """A table with an undeclared gear error."""
    return write(table(40, effects=("gear_harmonic J4=200 arcsec",)), folder / "cell.csv")


def start(*arguments: object, killed_at_write: int = 0) -> subprocess.Popen[str]:
    """The program in a process of its own, its lines of progress on `stderr`."""
    here = Path(__file__).parent
    places = os.pathsep.join([str(here), str(here.parent), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {
        "KILLED_AT_WRITE": str(killed_at_write), "PYTHONUNBUFFERED": "1", "PYTHONPATH": places,
    }  # fmt: skip
    command = [sys.executable, "-c", DRIVER, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment)


def begun(table: Path, out: Path, *more: object, **settings: Any) -> subprocess.Popen[str]:
    """A search that was just started."""
    return start("discover", table, "--mechanism", "irb6400r", *OPTIONS, "--out", out, *more, **settings)


def results(out: Path) -> dict[str, Any]:
    """Every number of the results, and the names of all files that are there."""
    report = json.loads((out / "report.json").read_text())
    del report["seconds"], report["command"]
    names = sorted(str(p.relative_to(out)) for p in out.rglob("*") if p.is_file())
    poses = pd.read_csv(out / "poses.csv").to_numpy().tolist()
    return {"report": report, "model": (out / "model.json").read_text(), "files": names, "poses": str(poses)}


@contextmanager
def small() -> Iterator[None]:
    """Make search and results as small as the driver's."""
    with mock.patch.object(discover, "Search", partial(Search, population=48, generations=4, climb=0)), brief():
        yield


def resume(out: Path) -> None:
    done = run("discover", "--resume", out, "--quiet")
    assert (done.exit_code, done.stderr) == (0, ""), done.output
