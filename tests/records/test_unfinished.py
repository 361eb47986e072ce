"""Test that saved parts of an interrupted search are read back, and set aside if damaged."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from effect_cases import numbers
from loop_cases import QUICK, found, quick, robot

from gpmodel import texts
from gpmodel.discovery.loop import discover
from gpmodel.errors import InputError
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Inputs, SlotProblem
from gpmodel.evolution.projection import regression
from gpmodel.evolution.search import Evolution, evolve
from gpmodel.evolution.settings import Budget, Settings
from gpmodel.progress import Say, silent
from gpmodel.records.unfinished import FOLDER, RunFiles, Unfinished, unfinished
from gpmodel.records.unfinished import REQUEST as REQUEST_FILE

REQUEST = {"files": {"table": "../cell.csv"}, "options": {"seed": 3, "noise": None}}
IDENTITY = {"gpmodel": "0", "the table": 64 * "a", "--seed": 3}


def files(folder: Path, say: Say = silent, **changed: object) -> Unfinished:
    return Unfinished(folder, REQUEST, IDENTITY | changed, say)


def kept(folder: Path) -> Unfinished:
    """Candidates kept in two files, as of two machines of a fleet."""
    notes = files(folder)
    notes.begin()
    for name in ("machine-1", "machine-2"):
        notes.write(name, {"found": [f.candidate for f in quick().findings], "number": 1})
    return notes


def evolution() -> Evolution:
    inputs = Inputs(("a", "b"), np.random.default_rng(0).uniform(-2, 2, (2, 60)))
    problem = SlotProblem(inputs, regression(np.sin(inputs["a"]) * inputs["b"] + inputs["a"] ** 2))
    settings = Settings(Linear(), budget=Budget(128, 10, seconds=1e9, climb=1))
    return evolve(problem, settings, np.random.default_rng(0))


@pytest.mark.parametrize("case", ["windup", "nothing"])
def test_candidates_read_back_to_the_bit(case: str, tmp_path: Path) -> None:
    candidates = tuple(f.candidate for f in found(case, 0).findings)
    notes = files(tmp_path)
    notes.begin()
    notes.write("machine-1", {"found": candidates})
    content = files(tmp_path).read("machine-1")
    assert content is not None
    assert content["found"] == candidates
    assert unfinished(tmp_path) == {"request": REQUEST, "identity": IDENTITY}


@pytest.mark.long
def test_a_kept_run_gives_a_round_what_the_run_gave(tmp_path: Path) -> None:
    done, notes = evolution(), RunFiles(files(tmp_path))
    notes.keep_run((1, 7), done)
    again = RunFiles(files(tmp_path)).run((1, 7))
    assert again is not None
    assert len(done.front) > 1
    for one, other in zip((again.best, *again.front), (done.best, *done.front), strict=True):
        assert {**vars(one), "coefficients": one.coefficients.tolist()} == {
            **vars(other), "coefficients": other.coefficients.tolist()
        }  # fmt: skip
    assert (again.evaluations, again.seconds) == (done.evaluations, done.seconds)
    assert notes.run((1, 8)) is None
    assert notes.run((2, 7)) is None


def test_numbers_that_are_not_finite_survive_in_text(tmp_path: Path) -> None:
    values, notes = np.array([-np.inf, np.inf, np.nan, 1.0]), files(tmp_path)
    notes.write("machine-1", {"values": values})
    (written,) = notes.folder.iterdir()
    json.loads(written.read_text(), parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    content = notes.read("machine-1")
    assert content is not None
    np.testing.assert_array_equal(content["values"], values)


DAMAGE: dict[str, Callable[[str], str]] = {
    "cut": lambda text: text[: len(text) // 2],
    "empty": lambda text: "",
    "other json": lambda text: "[1, 2]",
    "a number": lambda text: text.replace('"number": 1', '"number": 2'),
    "unknown type": lambda text: text.replace('"type": "Candidate"', '"type": "Path"'),
    "code": lambda text: text.replace("sin(2*J4)", "__import__('os')"),
    "deep": lambda text: "[" * 100_000,
    "no text": lambda text: "\ud800",
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_file_is_named_set_aside_and_done_again(kind: str, tmp_path: Path) -> None:
    kept(tmp_path)
    path = tmp_path / FOLDER / "machine-2.json"
    text = path.read_text()
    damaged = DAMAGE[kind](text)
    assert damaged != text
    path.write_bytes(damaged.encode("utf-8", "surrogatepass"))
    said: list[str] = []
    notes = files(tmp_path, lambda line: said.append(str(line)))
    assert notes.read("machine-1") is not None
    assert notes.read("machine-2") is None
    assert "machine-2.json" in said[0]
    assert "set aside" in said[0]
    assert "\n" not in said[0]
    assert path.with_name("machine-2.json.damaged").read_bytes() == damaged.encode("utf-8", "surrogatepass")
    assert not path.exists()


def test_a_damaged_request_is_named_and_set_aside(tmp_path: Path) -> None:
    kept(tmp_path)
    path = tmp_path / FOLDER / REQUEST_FILE
    path.write_text(path.read_text().replace('"seed": 3', '"seed": 4'))
    with pytest.raises(InputError, match=r"request.json: damaged .* set aside as request.json.damaged"):
        unfinished(tmp_path)
    assert unfinished(tmp_path) is None


def test_what_differs_is_said(tmp_path: Path) -> None:
    kept(tmp_path)
    before = sorted(p.name for p in (tmp_path / FOLDER).iterdir())
    with pytest.raises(InputError, match=r"other inputs: the table has changed; --seed is 4, was 3\."):
        files(tmp_path, **{"--seed": 4, "the table": 64 * "b"}).begin()
    assert sorted(p.name for p in (tmp_path / FOLDER).iterdir()) == before


def test_files_of_another_search_are_not_read(tmp_path: Path) -> None:
    """Copied from beside, their seal is whole; what they belong to is not this."""
    kept(tmp_path / "one")
    other = files(tmp_path / "other", **{"--seed": 4})
    other.begin()
    name = "machine-1.json"
    (other.folder / name).write_bytes((tmp_path / "one" / FOLDER / name).read_bytes())
    assert other.read("machine-1") is None
    assert (other.folder / f"{name}.damaged").exists()


def test_another_schema_is_refused_and_stays(tmp_path: Path) -> None:
    assert unfinished(tmp_path) is None
    texts.write_json(tmp_path / FOLDER / REQUEST_FILE, {"schema": 99})
    with pytest.raises(InputError, match="schema 99; this version resumes schema"):
        unfinished(tmp_path)
    assert (tmp_path / FOLDER / REQUEST_FILE).exists()


class Interrupted(Exception):
    pass


LONG = [pytest.param(moment, marks=pytest.mark.long) for moment in ("round 2", "round 2: evolving, 1 of")]


@pytest.mark.long
@pytest.mark.parametrize("moment", ["round 1: evolving, 1 of", *LONG])
def test_an_interrupted_run_goes_on_to_the_same_numbers(moment: str, tmp_path: Path) -> None:
    truth, train, heldout = robot("gear", 0)
    notes = RunFiles(Unfinished(tmp_path, {}, {}))

    def say(text: str) -> None:
        if str(text).startswith(moment):
            raise Interrupted

    with pytest.raises(Interrupted):
        discover(truth.model.mechanism, truth.poses, train, heldout, search=QUICK, progress=say, kept=notes)
    done = {path: path.stat().st_mtime_ns for path in notes.files.folder.glob("run-*")}
    assert max(path.name for path in done).startswith("run-2" if "2: evolving" in moment else "run-1")
    resumed = discover(truth.model.mechanism, truth.poses, train, heldout, search=QUICK, kept=notes)
    assert numbers(resumed) == numbers(quick())
    assert {path: path.stat().st_mtime_ns for path in done} == done
