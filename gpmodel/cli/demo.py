"""`gpmodel demo`: the main job on a shipped table, from nothing to the opened report."""

import dataclasses
import os
from importlib.resources import as_file, files
from pathlib import Path

import click

from gpmodel.cli.discover import discover_table, progress
from gpmodel.cli.options import quiet_option, seed_option, workers_option
from gpmodel.mechanism.source import MechanismChoice

TABLE = "demo.csv"
MECHANISM = "irb6400r"


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("demo-report"), show_default=True)
@seed_option
@workers_option
@quiet_option
def demo(out: Path, seed: int, workers: int | None, quiet: bool) -> None:
    """An IRB 6400R with an effect nobody declared: 90 poses in, the report out."""
    choice = MechanismChoice(MECHANISM)
    with as_file(files("gpmodel") / "data" / TABLE) as table, progress(quiet) as say:
        request = {
            "table": str(table), "choice": dataclasses.asdict(choice), "minutes": 1.0, "holdout": 0.3, "noise": None,
            "condition_limit": None, "seed": seed,
        }  # fmt: skip
        report = discover_table(request, out, say, workers)
    page = out / "report.html"
    if not quiet:
        click.echo(report.verdict)
        click.echo(f"report: {page}")
        if os.environ.get("DISPLAY") and not os.environ.get("CI"):
            click.launch(str(page))
