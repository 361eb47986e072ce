"""What the documents show runs: the lines of the README and the cells of the tour."""

import copy
import doctest
import shutil
from importlib.resources import files
from pathlib import Path

import nbformat
import pandas as pd
import pytest
from nbclient import NotebookClient

import gpmodel as gp
from gpmodel.discovery.search import Search

ROOT = Path(__file__).parents[2]
TOUR = nbformat.read(ROOT / "experiments" / "tour" / "tour.ipynb", as_version=4)
DEMO = Path(str(files("gpmodel") / "data" / "demo.csv"))


@pytest.mark.usefixtures("brief")
def test_the_lines_of_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(DEMO, "table.csv")
    frame = pd.read_csv(DEMO).head(5)
    for name in ("poses.csv", "targets.csv"):
        frame.drop(columns=["x [mm]", "y [mm]", "z [mm]"]).to_csv(name, index=False)
    result = doctest.testfile(str(ROOT / "README.md"), module_relative=False)
    assert result.attempted > 10
    assert result.failed == 0
    assert (tmp_path / "result" / "report.html").exists()


def test_the_readme_names_every_command() -> None:
    from gpmodel.cli.main import COMMANDS

    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [name for name in COMMANDS if f"gpmodel {name}" not in text] == []


@pytest.mark.usefixtures("brief")
def test_the_lines_of_the_tour_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All its cells in turn, with searches of the smallest size."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(gp, "Search", lambda **sizes: Search(**sizes | {"runs": 1, "population": 48, "generations": 4}))
    lines = [cell.source for cell in TOUR.cells if cell.cell_type == "code"]
    assert len(lines) > 10
    exec("\n".join(lines), {})
    assert (tmp_path / "result" / "report.html").exists()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_tour_runs_as_a_notebook(tmp_path: Path) -> None:
    notebook = copy.deepcopy(TOUR)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert (tmp_path / "result" / "report.html").exists()
