"""Code in the documents runs: the lines of the README and the cells of the tour."""

import copy
import doctest
import re
import shlex
import shutil
from importlib.resources import files
from pathlib import Path

import nbformat
import pandas as pd
import pytest
from click.testing import CliRunner
from nbclient import NotebookClient

import gpmodel as gp
from gpmodel.api import discover
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
@pytest.mark.parametrize("name", [*SHOWN[:2], pytest.param(SHOWN[2], marks=pytest.mark.long)])
def test_the_lines_that_a_document_shows_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With one share of the poses held out instead of every one in turn."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(discover, "ENOUGH_HELD", 1)
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
        said += [told for told in done.output.splitlines() if "of chance" in told]
    inputs = ("J2, torque_J3", "torque_J5", "torque_J4")
    assert said == [*(f"stands out of chance: {name}" for name in inputs), "no input stands out of chance"]
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
