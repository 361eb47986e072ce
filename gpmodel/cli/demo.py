"""`gpmodel demo`: the main job on a shipped table, from nothing to the opened report."""

import os
import sys
from importlib.resources import as_file, files
from pathlib import Path

import click

from gpmodel.cli.console import progress_line, what_next
from gpmodel.cli.discover import discover_request, settings
from gpmodel.cli.options import PATH, quiet_option, seed_option, workers_option
from gpmodel.cli.request import Request
from gpmodel.cli.terminal import echo
from gpmodel.discovery.search import Search
from gpmodel.files import folder_for
from gpmodel.forks import Forks
from gpmodel.mechanism.source import MechanismChoice

TABLE = "demo.csv"
MECHANISM = "irb6400r"


@click.command()
@click.option("--out", "folder", type=PATH, default=Path("demo-report"), show_default=True)
@click.option("--no-open", is_flag=True, help="Leave the page closed.")
@seed_option
@workers_option
@quiet_option
def demo(folder: Path, no_open: bool, seed: int, workers: int | None, quiet: bool) -> None:
    """An IRB 6400R with an effect nobody declared: 90 poses in, the report out."""
    folder_for(folder)
    with as_file(files("gpmodel") / "data" / TABLE) as table, progress_line(quiet) as say:
        options = {
            "runs": Search().runs, "holdout": None, "folds": None, "noise": None, "condition_limit": None,
            "instrument": None, "no_catalogue": False, "in_order": False, "seed": seed, "representation": "linear",
        }  # fmt: skip
        request = Request("discover", table, MechanismChoice(MECHANISM), options, settings())
        found = discover_request(request, folder, say, Forks(workers or 0))
    if not quiet:
        echo(found.summary())
        echo(what_next(folder, found.record))
        shown = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        if not no_open and shown and not os.environ.get("CI"):
            click.launch(str(folder / "report.html"))
