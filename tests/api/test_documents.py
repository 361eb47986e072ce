"""What the documents show runs: the lines of the README and the cells of the tour."""

import doctest
import shutil
from importlib.resources import files
from pathlib import Path

import nbformat
import pandas as pd
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).parents[2]
DEMO = Path(str(files("gpmodel") / "data" / "demo.csv"))


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


@pytest.mark.filterwarnings("ignore")
def test_the_tour_runs_from_the_table_to_the_report(tmp_path: Path) -> None:
    notebook = nbformat.read(ROOT / "experiments" / "tour" / "tour.ipynb", as_version=4)
    assert len(notebook.cells) > 10
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert (tmp_path / "result" / "report.html").exists()
