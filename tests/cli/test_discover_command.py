"""Test that `gpmodel discover` and `gpmodel demo` write a complete folder of results or none."""

import json
from collections.abc import Iterator
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from unittest import mock

import numpy as np
import pandas as pd
import pytest
from brief_results import brief
from cli_cases import one_line, run, table, write

from gpmodel.api import discover as api
from gpmodel.api.table import read_table
from gpmodel.application.model_file import load_model
from gpmodel.checks.notes import unknowns
from gpmodel.cli import demo as demo_command
from gpmodel.discovery.search import Search
from gpmodel.model.error_model import observe, pose_error, prepare
from gpmodel.model.sites import geometric_effects

RESULTS = {
    "report.html", "explore.html", "poses.csv", "report.json", "model.json", "calibrated.urdf", "exports", "figures",
}  # fmt: skip
GEAR = "gear_harmonic J4=200 arcsec"


def quick_search() -> AbstractContextManager[object]:
    """Runs, populations and generations for what does not depend on how much is found."""
    small = partial(Search, population=48, generations=4)
    return mock.patch("gpmodel.cli.discover.Search", small)


@pytest.fixture(autouse=True)
def quick() -> Iterator[None]:
    with quick_search():
        yield


def discover(*arguments: object) -> dict:  # type: ignore[type-arg]
    """The report of a run that ends well."""
    result = run("discover", *arguments, "--mechanism", "irb6400r", "--quiet", "--workers", 1, "--runs", 1)
    assert (result.exit_code, result.stdout, result.stderr) == (0, "", ""), result.output
    out = Path(str(arguments[arguments.index("--out") + 1]))
    return json.loads((out / "report.json").read_text())


def said_in(sentence: str, text: str) -> bool:
    """Return whether a text that is broken into lines contains a sentence."""
    return " ".join(sentence.split()) in " ".join(text.split())


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(table(70, effects=(GEAR,)), tmp_path_factory.mktemp("table") / "cell.csv")


@pytest.fixture(scope="module")
def done(measured: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one finished run."""
    out = tmp_path_factory.mktemp("runs") / "out"
    with quick_search(), brief():
        discover(measured, "--out", out, "--noise", "0.03mm", "--holdout", "0.3")
    return out


def test_it_leaves_the_results_and_nothing_else(done: Path) -> None:
    assert {p.name for p in done.iterdir()} == RESULTS
    assert list((done / "figures").glob("*.png"))
    report = json.loads((done / "report.json").read_text())
    assert [e["name"] for e in report["effects"]] == ["gear error, 2 per turn, J4"]
    assert report["noise_floor_mm"] == pytest.approx(0.03 * np.sqrt(3))
    assert len(report["data"]["sha256"]) == 64
    assert "gear error, 2 per turn, J4" in (done / "report.html").read_text()


def test_its_results_are_explained_certified_and_compared(done: Path, tmp_path: Path) -> None:
    said = run("explain", done, 1, "--out", tmp_path)
    assert said.exit_code == 0, said.output
    assert "gear error, 2 per turn, J4" in said.stdout
    assert "expected 1 to 1" in one_line(run("explain", done, 2), 2)
    assert run("certificate", done, "--machine", "cell 4", "--out", tmp_path).exit_code == 0
    assert "cell 4" in (tmp_path / "certificate.html").read_text()
    same = run("compare", done, done, "--out", tmp_path)
    assert same.exit_code == 0, same.output
    assert (tmp_path / "compare.html").exists()


def test_the_saved_model_is_the_optimised_one(done: Path, measured: Path) -> None:
    """Read back from text and put to the table, it beats the last rung, which saw the training poses alone."""
    saved = load_model(done / "model.json")
    poses = prepare(saved.mechanism, read_table(measured, saved.mechanism))
    errors = pose_error(observe(saved.model, poses, saved.theta, saved.placement), poses.dataset, saved.weights)
    report = json.loads((done / "report.json").read_text())
    values = {p["name"]: p["value"] for p in report["parameters"]}
    assert dict(zip((e.name for e in saved.model.effects), saved.theta, strict=True)) == pytest.approx(values)
    last = report["plots"]["error_mm"][report["ladder"][-1]["step"]]
    before = np.array([*last["train"], *last["heldout"]])
    assert 0.8 * np.sum(before**2) < np.sum((1e3 * errors) ** 2) < np.sum(before**2)


def test_the_model_predicts_the_table_it_came_from(done: Path, measured: Path, tmp_path: Path) -> None:
    frame = pd.read_csv(measured)
    joints = write(frame[[c for c in frame if c.startswith("J")]], tmp_path / "joints.csv")
    result = run("predict", done / "model.json", joints, "--out", tmp_path / "predicted.csv", "--quiet")
    assert result.exit_code == 0, result.stderr
    predicted = pd.read_csv(tmp_path / "predicted.csv")
    miss = [predicted[f"{a} [mm]"] - frame[f"{a} [mm]"] for a in "xyz"]
    assert np.sqrt(np.mean(np.sum(np.square(miss), axis=0))) < 0.06


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_trees_are_evolved_beside_sequences_where_asked(measured: Path, tmp_path: Path) -> None:
    report = discover(measured, "--representation", "linear,tree", "--out", tmp_path / "out", "--holdout", 0.3)
    for counted in report["histograms"]:
        assert set(counted["counts"]) == {"linear", "tree"}
        assert counted["runs"] == {"linear": 1, "tree": 1}


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_finding_nothing_is_a_success_which_is_said_with_what_was_tried_and_what_comes_next(tmp_path: Path) -> None:
    result = run(
        "discover", write(table(60, seed=3), tmp_path / "t.csv"), "--mechanism", "irb6400r", "--out", tmp_path / "o",
        "--runs", 1, "--holdout", 0.3,
    )  # fmt: skip
    assert result.exit_code == 0
    for said in ("standard model", "round 1", "evolving", "writing the report"):
        assert said in result.stderr
    report = json.loads((tmp_path / "o" / "report.json").read_text())
    assert report["effects"] == []
    assert report["verdict"].startswith("Nothing was added")
    assert said_in(report["verdict"], result.stdout)
    for said in (
        "held out",
        "to know the noise floor",
        f"report: {tmp_path / 'o' / 'report.html'}",
        "gpmodel compensate",
    ):
        assert said in result.stdout


BAD: dict[str, tuple[list[str], str]] = {
    "no table": (["--mechanism", "irb6400r"], "Missing argument 'TABLE'"),
    "no mechanism": (["{table}"], "Missing option '--mechanism'"),
    "holdout": (["{table}", "--mechanism", "irb6400r", "--holdout", "30"], "--holdout: 30.0, expected a share"),
    "holdout that is no number": (["{table}", "--mechanism", "irb6400r", "--holdout", "nan"], "--holdout: nan"),
    "noise of nothing": (["{table}", "--mechanism", "irb6400r", "--noise", "0mm"], "--noise: 0mm"),
    "negative noise": (["{table}", "--mechanism", "irb6400r", "--noise", "-1mm"], "--noise: -1mm"),
    "condition limit that is no number": (
        ["{table}", "--mechanism", "irb6400r", "--condition-limit", "nan"],
        "--condition-limit: nan",
    ),
    "minutes without end": (["{table}", "--mechanism", "irb6400r", "--minutes", "inf"], "--minutes"),
    "minutes that are no number": (["{table}", "--mechanism", "irb6400r", "--stop-after", "nan"], "--minutes"),
    "two ways to hold out": (
        ["{table}", "--mechanism", "irb6400r", "--folds", "3", "--holdout", "0.2"],
        "--folds",
    ),
    "representation": (["{table}", "--mechanism", "irb6400r", "--representation", "tree,tree"], "each once"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_writes_nothing(
    case: str, measured: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments, said = BAD[case]
    line = one_line(run("discover", *[a.format(table=measured) for a in arguments], "--out", "out", "--quiet"), 2)
    assert said in line
    assert list(tmp_path.iterdir()) == []


def test_where_nothing_was_interrupted_nothing_is_resumed(tmp_path: Path) -> None:
    assert "nowhere has no unfinished search" in one_line(run("discover", "--resume", tmp_path / "nowhere"), 2)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_the_demo_goes_from_nothing_to_the_report(tmp_path: Path) -> None:
    """With two folds instead of the usual five."""
    with (
        mock.patch.object(demo_command, "Search", partial(Search, runs=1, population=48, generations=4)),
        mock.patch.object(api, "FOLDS", 2),
    ):
        result = run("demo", "--out", tmp_path / "demo", "--workers", 1)
    assert result.exit_code == 0, result.output
    assert {p.name for p in (tmp_path / "demo").iterdir()} == RESULTS
    report = json.loads((tmp_path / "demo" / "report.json").read_text())
    assert said_in(report["verdict"], result.stdout)
    assert str(tmp_path / "demo" / "report.html") in result.stdout


@pytest.mark.slow
def test_the_demo_finds_what_was_planted(tmp_path: Path) -> None:
    with mock.patch("gpmodel.cli.discover.Search", Search):
        assert run("demo", "--out", tmp_path / "demo", "--quiet").exit_code == 0
    report = json.loads((tmp_path / "demo" / "report.json").read_text())
    assert report["effects"]
    assert report["ladder"][-1]["heldout"]["rms_mm"] < 0.6 * report["ladder"][1]["heldout"]["rms_mm"]


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_table_like_mine_holds_what_its_standard_model_needs(name: str) -> None:
    made = demo_command.like_mine(name, seed=3)
    said = demo_command.to_measure(made, name, Path("my demo/table.csv"))
    needed = unknowns(made.truth.mechanism, made.table, geometric_effects(made.truth.mechanism))
    assert 0 <= 3 * len(made.table) - 6 * needed < 30
    assert f"planted: gear error, 2 per turn, {made.truth.mechanism.joints[1].name}" in said
    assert f"gpmodel poses --mechanism {name} -n {len(made.table)}" in said


@pytest.mark.long
def test_the_demo_of_my_mechanism_shows_what_was_planted(tmp_path: Path) -> None:
    result = run("demo", "--mine", "ur5", "--out", tmp_path / "demo")
    assert result.exit_code == 0, result.stderr
    assert "gear error, 2 per turn, shoulder_lift_joint" in result.stdout.split("[[Findings]]")[1]
    assert {"report.html", "table.csv", "table.truth.json"} <= {p.name for p in (tmp_path / "demo").iterdir()}


@pytest.mark.long
def test_one_worker_is_this_process_to_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused() -> int:
        raise AssertionError("a process was made")

    monkeypatch.setattr("os.fork", refused)
    made = ["discover", write(table(24), tmp_path / "t.csv"), "--mechanism", "irb6400r", "--no-catalogue"]
    done = run(*made, "--runs", 0, "--workers", 1, "--out", tmp_path / "out", "--quiet")
    assert (done.exit_code, done.stderr) == (0, "")
    assert (tmp_path / "out" / "report.html").exists()
