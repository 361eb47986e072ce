"""A table that grows is looked at after every batch: how things stand, and where to measure next."""

import json
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest
from cli_cases import one_line, run, table
from durable_cases import OPTIONS, small

from gpmodel.api.discover import DiscoveryResult
from gpmodel.cli import watch
from gpmodel.errors import InputError
from gpmodel.progress import Progress, Say


@pytest.fixture(autouse=True)
def quick() -> Iterator[None]:
    with small():
        yield


@pytest.mark.long
def test_it_follows_a_table_and_leaves_verdict_and_next_poses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, out = tmp_path / "cell.csv", tmp_path / "out"
    lines = table(45, effects=("gear_harmonic J4=400 arcsec",)).to_csv(index=False).splitlines(keepends=True)
    looks = iter([lines[:4], lines[4:10], [lines[10][:5]], [lines[10][5:]], lines[11:36], lines[36:]])

    def measure(_: float) -> None:
        """Between two looks; once the table rests, somebody measures on."""
        size = path.stat().st_size if path.exists() else 0
        if size == measure.size:  # type: ignore[attr-defined]
            with path.open("a") as file:
                file.writelines(next(looks, []))
        measure.size = size  # type: ignore[attr-defined]

    measure.size = 0  # type: ignore[attr-defined]
    monkeypatch.setattr(watch.time, "sleep", measure)
    done = run(
        "discover", path, "--mechanism", "irb6400r", *OPTIONS, "--no-catalogue", "--out", out, "--watch",
        "--batch", 10, "--rows", 45,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    said = done.stdout.splitlines()
    assert said[0].startswith("10 rows: ")
    assert [line.split(" rows: ")[0] for line in said if " rows: " in line][-2:] == ["35", "45"]
    assert json.loads((out / "report.json").read_text())["verdict"] in said[-2]
    assert said[-1].startswith("next 10 poses, ")
    assert len(pd.read_csv(out / watch.NEXT)) == 10


def test_rows_that_come_while_it_is_busy_are_said_to_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, said = tmp_path / "cell.csv", list[str]()
    path.write_text("x\n" + 4 * "1\n")
    monkeypatch.setattr(watch.time, "sleep", lambda _: None)

    def look(say: Say) -> DiscoveryResult:
        for come in (1, 4, 0, 2):
            with path.open("a") as file:
                file.write(come * "1\n")
            say(Progress("one of the runs", passing=True))
        raise InputError("too few poses")

    watch.Watch(path, batch=2, rows=4).follow(look, tmp_path, said.append)
    assert said == ["5 new rows wait", "7 new rows wait", "4 rows: too few poses"]


def test_a_table_that_shrank_is_another_and_a_workbook_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "cell.csv"
    path.write_text("x\n" + 3 * "1\n")
    monkeypatch.setattr(watch.time, "sleep", lambda _: None)
    assert watch.Watch(path, batch=2)._grown(seen=40) == 3
    line = one_line(run("discover", tmp_path / "t.xlsx", "--mechanism", "irb6400r", "--out", tmp_path, "--watch"), 2)
    assert "--watch" in line


def test_a_folder_is_no_table_that_grows(tmp_path: Path) -> None:
    followed = run("discover", tmp_path, "--mechanism", "irb6400r", "--watch", "--rows", 5, "--out", tmp_path / "out")
    assert f"{tmp_path}: cannot be read (Is a directory); expected a measured table" in one_line(followed, 2)
