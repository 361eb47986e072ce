"""Test output, files, resumption and refusals of `gpmodel evolve`."""

import json
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from cli_cases import one_line
from cli_cases import run as main_with
from click.testing import CliRunner, Result

from gpmodel.api.evolve import Effort, default_strategies, settings_for
from gpmodel.cli.discover import evolve
from gpmodel.cli.poses import simulate
from gpmodel.errors import InputError
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.settings import Truncation
from gpmodel.evolution.tree import Tree
from gpmodel.formula.expression import parse
from gpmodel.progress import Reporter
from gpmodel.records.unfinished import FOLDER
from gpmodel.report.saved import read_report

QUICK = ["--mechanism", "irb6400r", "--population", "200", "--generations", "3", "--runs", "2"]


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("evolve") / "poses.csv"
    options = ["--mechanism", "irb6400r", "--poses", "60", "--effect", "gear_harmonic J4=200 arcsec", "--out", path]
    assert CliRunner().invoke(simulate, [str(o) for o in options], catch_exceptions=False).exit_code == 0
    return path


def run(*arguments: object) -> Result:
    return CliRunner().invoke(evolve, [str(a) for a in arguments], catch_exceptions=False)


@pytest.mark.parametrize("space", [pytest.param("cartesian", marks=pytest.mark.long), "slot"])
def test_both_representations_are_counted_beside_shuffled_runs(space: str, table: Path, tmp_path: Path) -> None:
    result = run(table, *QUICK, "--space", space, "--out", tmp_path)
    assert "on permuted residuals" in result.output
    assert "of permuted residuals" in result.output
    shown = json.loads((tmp_path / "report.json").read_text())
    gains = {side: [r["gain"] for r in shown["runs"] if r["shuffled"] == side] for side in (False, True)}
    record = read_report(tmp_path)
    assert [record.removed(side) for side in gains] == pytest.approx([np.median(of) for of in gains.values()])
    assert "of permuted residuals" in (tmp_path / "report.html").read_text(encoding="utf-8")
    report = shown
    (counted,) = report["histograms"]
    assert counted["runs"] == counted["shuffled_runs"] == {"linear": 2, "tree": 2}
    assert len(report["runs"]) == 8
    for kind in ("linear", "tree"):
        programs = [parse(r["program"]) for r in report["runs"] if r["representation"] == kind and not r["shuffled"]]
        expected = [sum(name in program.inputs for program in programs) for name in counted["inputs"]]
        assert counted["counts"][kind] == expected
    assert {"x", "y", "z", "J1", "J6"} <= set(counted["inputs"])
    assert len((tmp_path / "programs.txt").read_text().splitlines()) == 4


@pytest.mark.long
def test_an_interrupted_search_goes_on_with_resume_alone_to_the_same_numbers(table: Path, tmp_path: Path) -> None:
    options = [*QUICK, "--space", "slot", "--standard", "J* R?"]
    run(table, *options, "--out", tmp_path / "whole", "--workers", 2)
    out = tmp_path / "out"
    said = Reporter.__call__

    def stopped(teller: Reporter, text: str, passing: bool = False) -> None:
        said(teller, text, passing)
        if "5 of 8" in text:
            raise KeyboardInterrupt

    with mock.patch.object(Reporter, "__call__", stopped):
        interrupted = main_with("evolve", table, *options, "--out", out, "--workers", 1)
    assert interrupted.exit_code == 130
    assert f"gpmodel evolve --resume {out}" in interrupted.stderr
    assert [p.name for p in out.iterdir()] == [FOLDER]
    assert len(list((out / FOLDER).glob("run-*.json"))) == 5
    assert "the unfinished run belongs to evolve" in one_line(main_with("discover", "--resume", out, "--quiet"), 2)
    other = main_with("evolve", table, *options, "--out", out, "--seed", 1, "--quiet")
    assert "unfinished search has other inputs: --seed is 1, was 0" in one_line(other, 2)
    resumed = main_with("evolve", "--resume", out)
    assert resumed.exit_code == 0
    assert "5 finished runs" in resumed.stderr
    assert not (out / FOLDER).exists()
    assert "nothing is left to do" in main_with("evolve", "--resume", out).stdout
    runs, again = (json.loads((folder / "report.json").read_text())["runs"] for folder in (tmp_path / "whole", out))
    for one, other in zip(runs, again, strict=True):
        for column in (one, other):
            del column["seconds"], column["history"]["seconds"], column["history"]["evaluations_per_second"]
        assert one == other


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--representation", "forest"], "expected linear or tree"),
        (["--operators", "thesis,sinus"], "unknown 'sinus'"),
        (["--population", "20"], "too small to select"),
        (
            ["--truncation", "0.1", "--tournament", "3"],
            "truncation: cannot be combined with --tournament, expected one of the two",
        ),
        (["--representation", "tree", "--length", "80"], "length: does not apply to tree"),
        (["--depth", "0"], "depth: 0, expected 1 to 40"),
    ],
)
def test_bad_options_are_one_clear_line(options: list[str], message: str, table: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        run(table, "--mechanism", "irb6400r", *options)
    assert "\n" not in str(caught.value)


def test_thesis_settings_are_the_default_in_cartesian_space() -> None:
    chosen = settings_for("cartesian", default_strategies("cartesian"), Effort())
    linear, tree = chosen["linear"], chosen["tree"]
    assert (linear.budget.population, linear.selection) == (65536, Truncation(0.05))
    assert linear.representation == Linear.thesis()
    assert (Linear.thesis().length, Linear.thesis().crossover, Linear.thesis().mutation) == (160, 0.01, 0.01)
    assert 10 <= Tree.thesis().depth <= 15
    assert tree.representation == Tree.thesis()
    assert settings_for("slot", default_strategies("slot"), Effort(seconds=2.0))["linear"].budget.generations > 10**5


@pytest.mark.long
def test_selection_rates_length_and_depth_are_asked_for_by_option(table: Path, tmp_path: Path) -> None:
    """Step 3 of the thesis' six: the settings of evolution are varied."""
    varied = ["--tournament", 3, "--crossover", 0.1, "--mutation", 0.02, "--length", 60, "--depth", 7]
    run(table, *QUICK, *varied, "--out", tmp_path, "--quiet")
    _, linear, tree = json.loads((tmp_path / "report.json").read_text())["settings"]
    assert "Tournament(size=3" in linear
    assert "Tournament(size=3" in tree
    assert "length=60" in linear
    assert "mutation=0.02" in linear
    assert "crossover=0.1" in linear
    assert "depth=7" in tree
    assert "crossover=0.1" in tree


@pytest.mark.long
def test_the_front_of_every_run_is_kept(table: Path, tmp_path: Path) -> None:
    run(table, *QUICK, "--out", tmp_path, "--quiet")
    for one in json.loads((tmp_path / "report.json").read_text())["runs"]:
        sizes, gains, texts = zip(*one["front"], strict=True)
        assert sorted(set(sizes)) == list(sizes)
        assert sorted(set(gains)) == list(gains)
        assert one["program"] in texts
        assert one["gain"] == max(gains)
