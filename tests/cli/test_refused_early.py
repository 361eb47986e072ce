"""Test that too large, contradictory or destructive requests are refused in one line before any work."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from cli_cases import one_line, robot, run, table, write

import gpmodel as gp

GOOD = table()


def wide(count: int) -> str:
    """The text of a table with so many more columns."""
    names, *rows = GOOD.to_csv(index=False).splitlines()
    more = "".join(f",c{i} [mm]" for i in range(count))
    return "\n".join([names + more, *(row + ",1" * count for row in rows)])


TABLES: dict[str, tuple[Callable[[], pd.DataFrame | str], str]] = {
    "columns": (lambda: wide(5000), "5009 columns; expected at most 1000"),
    "more columns": (lambda: wide(30_000), "a header of "),
    "a long name": (lambda: GOOD.assign(**{"a" * 10**6 + " [mm]": "1"}), "a header of 1000"),
    "a joint in another case": (
        lambda: GOOD.assign(**{"j1 [deg]": "1"}),
        "column 'j1': not a joint; expected 'J1'",
    ),
    "an empty joint": (lambda: GOOD.assign(**{"J2 [deg]": ""}), "column 'J2': empty in every row; expected a number"),
    "a label with a quote": (
        lambda: GOOD.assign(tool='1.5" SMR'),
        "column 'tool', row 1: label",
    ),
    "a label that steers": (lambda: GOOD.assign(setup="a\x1b[2J"), "column 'setup', row 1: control characters"),
    "a header that steers": (lambda: GOOD.assign(**{"a\x07 [mm]": "1"}), "column 10 has control characters"),
}


@pytest.mark.parametrize("case", TABLES)
def test_a_table_is_refused(case: str, tmp_path: Path) -> None:
    make, said = TABLES[case]
    made, path = make(), tmp_path / "t.csv"
    path.write_text(made) if isinstance(made, str) else write(made, path)
    line = one_line(run("check", path, "--mechanism", "irb6400r"), 2)
    assert said in line
    assert len(line) < 400


def test_line_ends_within_headers_and_labels_are_spaces() -> None:
    frame = GOOD.rename(columns={"J1 [deg]": "J1\n[deg]"}).assign(setup="left\nhand")
    read = gp.read_table(frame, "irb6400r")
    assert read.columns[0] == "J1"
    assert set(read.label("setup")) == {"left hand"}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    mechanism, made = robot(40)
    path = tmp_path_factory.mktemp("model") / "model.json"
    gp.calibrate(mechanism, made.dataset).model.save(path)
    return path


def test_a_pipe_beside_a_model_is_not_waited_for(model: Path, tmp_path: Path) -> None:
    (tmp_path / "model.json").write_text(model.read_text())
    os.mkfifo(tmp_path / "report.json")
    assert run("predict", tmp_path / "model.json", write(GOOD[:3], tmp_path / "t.csv")).exit_code == 0


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "--mechanism", "irb6400r", "--poses", 3],
        ["predict", "MODEL", "POSES"],
        pytest.param(["poses", "--mechanism", "irb6400r", "-n", 3], marks=pytest.mark.long),
        pytest.param(["compensate", "MODEL", "POSES"], marks=pytest.mark.long),
    ],
    ids=["simulate", "predict", "poses", "compensate"],
)
def test_a_measured_table_is_not_replaced(words: list[object], model: Path, tmp_path: Path) -> None:
    measured = write(GOOD, tmp_path / "measured.csv")
    poses = write(GOOD.filter(like="J")[:3], tmp_path / "poses.csv")
    words = [{"MODEL": model, "POSES": poses}.get(str(word), word) for word in words]
    before = measured.read_bytes()
    line = one_line(run(*words, "--out", measured), 2)
    assert "measured.csv: contains measurements, which would be overwritten; expected another name" in line
    assert measured.read_bytes() == before
    for _ in range(2):  # its own output is replaced
        assert run(*words, "--out", tmp_path / "own.csv").exit_code == 0


def test_the_targets_of_a_task_are_not_replaced_by_poses(model: Path, tmp_path: Path) -> None:
    targets = write(GOOD.filter(like="J")[:3], tmp_path / "targets.csv")
    before, link = targets.read_bytes(), tmp_path / "link.csv"
    link.symlink_to(targets)
    for out in (targets, link):
        line = one_line(run("poses", "-n", 3, "--after", model, "--task", targets, "--out", out), 2)
        assert f"{out.name} is read by this command; expected another name" in line
    assert targets.read_bytes() == before


def test_too_little_memory_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise MemoryError("Unable to allocate 3.5 TiB")

    monkeypatch.setattr("gpmodel.cli.poses.measure", refuse)
    line = one_line(run("simulate", "--mechanism", "irb6400r"), 2)
    assert "not enough memory (Unable to allocate 3.5 TiB); expected fewer poses" in line


class Wrong:
    """A basis of another shape."""

    inputs = ("J1",)

    def __call__(self, states: object) -> np.ndarray:
        return np.zeros((3, 2))

    def __str__(self) -> str:
        return "J1"


CALLS: dict[str, tuple[Callable[[Path, Path], object], str]] = {
    "a text for a file": (lambda m, p: gp.load_model(m).predict("J1 [deg],J2 [deg]\n" * 200), "cannot be read"),
    "a lambda for a basis": (lambda m, p: gp.effect_at("e", "J1.moving", "Rz", lambda s: s["J1"]), "is no basis"),
    "a basis of another shape": (
        lambda m, p: gp.calibrate("irb6400r", GOOD, [gp.effect_at("e", "J1.moving", "Rz", Wrong())]),
        "values of shape (3, 2)",
    ),
    "a name that is none": (lambda m, p: gp.load_model(m).save(str(p / "a\0b")), "expected a path"),
}


@pytest.mark.parametrize("case", CALLS)
def test_a_call_with_what_it_cannot_take_is_one_line(case: str, model: Path, tmp_path: Path) -> None:
    call, said = CALLS[case]
    with pytest.raises(gp.InputError) as caught:
        call(model, tmp_path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
