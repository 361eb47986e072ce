"""`gpmodel explain`: a finding in words."""

from pathlib import Path

import click

from gpmodel.api.next_poses import tellable_rivals
from gpmodel.cli.options import quiet_option
from gpmodel.files import write_text
from gpmodel.report.explain import explain as finding
from gpmodel.report.explain import html, text
from gpmodel.report.saved import read_report


@click.command()
@click.argument("result", metavar="DIR", type=click.Path(path_type=Path))
@click.argument("number", metavar="N", type=click.IntRange(1))
@click.option("--out", "folder", type=click.Path(path_type=Path), default=None, help="Folder for a page of it.")
@quiet_option
def explain(result: Path, number: int, folder: Path | None, quiet: bool) -> None:
    """Say finding N of the results in DIR in words: where it sits, how large it is at the tool, what would cause it,
    what to measure to be sure."""
    record = read_report(result)
    asked = 1 <= number <= len(record.effects) and record.effects[number - 1].close_rivals()
    tellable = tellable_rivals(result) if asked else None
    if not quiet:
        click.echo(text(finding(record, number, tellable)))
    if folder is not None:
        write_text(folder / f"finding_{number}.html", html(record, number, tellable))
