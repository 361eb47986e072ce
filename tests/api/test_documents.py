"""Test that the code in README, pages and tour runs."""

import copy
import doctest
import json
import re
import shlex
import shutil
from functools import partial
from importlib.resources import files
from pathlib import Path
from unittest import mock

import nbformat
import pandas as pd
import pytest
from cli_cases import run, table, write
from click.testing import CliRunner
from instances import some
from nbclient import NotebookClient

import gpmodel as gp
from gpmodel.api import discover
from gpmodel.api.discover import DiscoveryResult
from gpmodel.cli.main import main
from gpmodel.discovery.search import Search

ROOT = Path(__file__).parents[2]
TOUR = nbformat.read(ROOT / "experiments" / "tour" / "tour.ipynb", as_version=4)
EXAMPLES = ROOT / "docs" / "make" / "examples.py"
DEMO = Path(str(files("gpmodel") / "data" / "demo.csv"))


SHOWN = ("README.md", "docs/extending.md", "docs/tutorials/researcher.md")
"""Documents with lines of Python, as `>>>`."""
LINK = re.compile(r"(?:\]\(|src(?:set)?=\")([^)#\s\"]+)")
MOST_LINES = 150


@pytest.mark.usefixtures("brief")
@pytest.mark.parametrize("name", some(SHOWN, "README.md"))
def test_the_lines_that_a_document_shows_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With searches of the smallest size, and one share of the poses held out instead of every one in turn."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(discover, "ENOUGH_HELD", 1)
    monkeypatch.setattr(gp, "Search", lambda **sizes: Search(**sizes | {"population": 48, "generations": 4}))
    shutil.copy(DEMO, "table.csv")
    frame = pd.read_csv(DEMO).head(5)
    for file in ("poses.csv", "targets.csv"):
        frame.drop(columns=["x [mm]", "y [mm]", "z [mm]"]).to_csv(file, index=False)
    result = doctest.testfile(str(ROOT / name), module_relative=False)
    assert result.attempted > 7
    assert result.failed == 0
    assert name != "README.md" or (tmp_path / "result" / "report.html").exists()


@pytest.mark.long
def test_the_six_steps_typed_end_at_the_three_causes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands of the tutorial, one process each time."""
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "tutorials" / "six_steps.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    said = []
    for line in (line for block in blocks for line in block.replace("\\\n", "").splitlines()):
        _, command, *options = shlex.split(line)
        alone = ["--workers", "1"] if command == "evolve" else []
        done = CliRunner().invoke(main, [command, *options, *alone], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        said += [told for told in done.output.splitlines() if told.startswith("significant inputs:")]
    inputs = ("J2, torque_J3", "torque_J5", "torque_J4", "none")
    assert said == [f"significant inputs: {name}" for name in inputs]
    assert all(line in text for line in (said[0], said[-1]))
    table = re.findall(r"\| ([\d.]+ ± [\d.]+) ", text)
    effects = gp.load_result("base_J5_J4").findings
    sizes = [f"{1e9 * e.value:.1f} ± {1e9 * e.stderr:.1f}" for e in effects[:1]]
    assert [*sizes, *(f"{1e6 * e.value:.2f} ± {1e6 * e.stderr:.2f}" for e in effects[1:])] == table


def test_no_document_with_lines_of_python_is_left_out() -> None:
    documents = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    assert {str(d.relative_to(ROOT)) for d in documents if ">>> " in d.read_text(encoding="utf-8")} == set(SHOWN)


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_every_public_name_has_an_example_and_all_of_them_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = EXAMPLES.read_text(encoding="utf-8")
    assert [name for name in gp.__all__ if f"\n# {name}: " not in text] == []
    monkeypatch.chdir(tmp_path)
    shutil.copy(DEMO, "table.csv")
    exec(compile(text, "examples.py", "exec"), {"__name__": "examples"})
    assert (tmp_path / "model.json").exists()


def test_the_readme_is_short_and_leads_nowhere_that_is_not_there() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    targets = [t for t in LINK.findall(text) if not t.startswith("http")]
    assert len(targets) > 10
    assert [t for t in targets if not (ROOT / t).exists()] == []


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_the_lines_of_the_tour_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All its cells in turn, with searches of the smallest size and one share of the poses held out."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(discover, "ENOUGH_HELD", 1)
    monkeypatch.setattr(gp, "Search", lambda **sizes: Search(**sizes | {"runs": 1, "population": 48, "generations": 4}))
    lines = [cell.source for cell in TOUR.cells if cell.cell_type == "code"]
    assert len(lines) > 10
    names: dict[str, object] = {}
    exec("\n".join(lines), names)
    assert "report.html" in names["written"]  # type: ignore[operator]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_tour_runs_as_a_notebook(tmp_path: Path) -> None:
    notebook = copy.deepcopy(TOUR)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert list(tmp_path.iterdir()) == []


def test_every_fault_that_cannot_come_back_has_its_test() -> None:
    rows = re.findall(r"`(\S+\.py)::(test_\w+)`", (ROOT / "docs/reference/safety.md").read_text(encoding="utf-8"))
    lost = [name for file, name in rows if f"def {name}(" not in (ROOT / "tests" / file).read_text(encoding="utf-8")]
    assert len(rows) > 40
    assert lost == []


SMALL = partial(gp.Search, population=48, generations=4)
GEAR = table(70, effects=("gear_harmonic J4=200 arcsec",))


@pytest.fixture(scope="module")
def rows(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(GEAR, tmp_path_factory.mktemp("table") / "rows.csv")


@pytest.fixture(scope="module")
def found(rows: Path) -> DiscoveryResult:
    return gp.discover(gp.load_mechanism("irb6400r"), rows, search=SMALL(runs=1), noise="0.03 mm", holdout=0.3)


def comparable(folder: Path) -> dict[str, object]:
    report = json.loads((folder / "report.json").read_text())
    return {key: value for key, value in report.items() if key not in ("seconds", "command")}


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_it_gives_what_the_command_gives_whatever_the_number_of_workers(
    found: DiscoveryResult, rows: Path, tmp_path: Path
) -> None:
    with mock.patch("gpmodel.cli.discover.Search", SMALL):
        command = run(
            "discover", rows, "--mechanism", "irb6400r", "--runs", 1, "--noise", "0.03mm", "--holdout", 0.3,
            "--workers", 1, "--out", tmp_path / "command", "--quiet",
        )  # fmt: skip
    assert command.exit_code == 0, command.output
    found.save(tmp_path / "report.json")
    found.model.save(tmp_path / "model.json")
    assert comparable(tmp_path) == comparable(tmp_path / "command")
    assert (tmp_path / "model.json").read_text() == (tmp_path / "command" / "model.json").read_text()


@pytest.mark.slow
def test_on_the_shipped_demo_the_default_search_finds_the_compliance_and_gives_what_the_command_gives(
    tmp_path: Path,
) -> None:
    assert run("demo", "--out", tmp_path / "command", "--quiet").exit_code == 0
    arm = gp.load_mechanism("irb6400r")
    found = gp.discover(arm, gp.read_table(DEMO, arm))
    found.save(tmp_path / "report.json")
    assert comparable(tmp_path) == comparable(tmp_path / "command")
    assert [f.name for f in found.findings] == ["joint compliance, J5"]
    assert found.record.ladder[-1].heldout.rms_mm == pytest.approx(0.036, abs=0.001)


@pytest.mark.long
@pytest.mark.usefixtures("brief")
def test_a_result_says_what_was_found_and_keeps_it(found: DiscoveryResult, tmp_path: Path) -> None:
    assert [f.name for f in found.findings] == ["gear error, 2 per turn, J4"]
    assert found.verdict in " ".join(found.summary().split())
    rows = found.to_dataframe()
    assert rows.loc[0, "unit"] == "rad"
    assert rows.loc[0, "value"] > 3 * rows.loc[0, "stderr"]
    assert repr(found) == "<discovery on rows.csv: added gear error, 2 per turn, J4>"
    assert "<table" in found._repr_html_()
    found.report(tmp_path / "out")
    found.save(tmp_path / "found.json")
    kept, written = (json.loads((tmp_path / name).read_text()) for name in ("found.json", "out/report.json"))
    assert written["exports"]
    assert kept == written
    found.model.save(tmp_path / "model.json")
    assert gp.load_model(tmp_path / "model.json").misses(GEAR).mean() < 0.1


@pytest.mark.long
def test_own_families_and_effects_are_judged_like_all_others() -> None:
    arm = gp.load_mechanism("irb6400r")
    said: list[str] = []
    mine = gp.effect_at("cable drag", "J4.moving", "Rx", gp.Expression("tanh(3*sin(J4))*J2"))
    measured = table(70, effects=("J4.moving:Rx:tanh(3*sin(J4))*J2=0.5 mrad",))
    found = gp.discover(
        arm,
        measured,
        search=SMALL(runs=1),
        holdout=0.3,
        candidates=(*gp.catalogue, mine),
        progress=lambda say: said.append(str(say)),
    )
    assert [f.name for f in found.findings] == [mine.name]
    assert found.findings[0].value == pytest.approx(5e-4, rel=0.05)
    assert any("round 1: evolving" in line for line in said)
    strict = gp.Criteria(minimum_nats=1e9)
    assert gp.discover(arm, measured, search=SMALL(runs=1), holdout=0.3, criteria=strict).findings == ()


@pytest.mark.long
def test_evolving_gives_runs_beside_those_on_shuffled_errors(tmp_path: Path) -> None:
    arm = gp.load_mechanism("irb6400r")
    result = gp.evolve(arm, GEAR, space="slot", strategies=(gp.Linear(),), runs=2, population=64, generations=3)
    assert len(result.to_dataframe()) == 4
    assert set(result.inputs().columns) == {"input", "linear", "linear shuffled", "p_value"}
    path = write(GEAR, tmp_path / "t.csv")
    command = run(
        "evolve", path, "--mechanism", "irb6400r", "--space", "slot", "--representation", "linear", "--runs", 2,
        "--population", 64, "--generations", 3, "--out", tmp_path / "command",
    )  # fmt: skip
    assert command.stdout.startswith(result.summary())
    assert (tmp_path / "command" / "programs.txt").read_text() == result.programs()
