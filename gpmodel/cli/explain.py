"""`gpmodel explain`: a finding in words."""

from pathlib import Path

import click

from gpmodel.api.saved import explain as finding
from gpmodel.cli.options import quiet_option


@click.command()
@click.argument("result", metavar="DIR", type=click.Path(path_type=Path))
@click.argument("number", metavar="N", type=click.IntRange(1))
@click.option("--out", "folder", type=click.Path(path_type=Path), default=None, help="Folder for a page of it.")
@quiet_option
def explain(result: Path, number: int, folder: Path | None, quiet: bool) -> None:
    """Say finding N of the results in DIR in words: where it sits, how large it is at the tool, what would cause it,
    what to measure to be sure."""
    found = finding(result, number)
    if not quiet:
        click.echo(found.summary())
    if folder is not None:
        found.report(folder)
