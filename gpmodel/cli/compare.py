"""`gpmodel compare`: what changed between two calibrations of a machine."""

from pathlib import Path

import click

from gpmodel.api.saved import compare as changes
from gpmodel.cli.options import quiet_option


@click.command()
@click.argument("before", metavar="A", type=click.Path(path_type=Path))
@click.argument("after", metavar="B", type=click.Path(path_type=Path))
@click.option("--out", "folder", type=click.Path(path_type=Path), default=None, help="Folder for a page of it.")
@quiet_option
def compare(before: Path, after: Path, folder: Path | None, quiet: bool) -> None:
    """Say what changed between the results in A and B, parameter by parameter and effect by effect."""
    found = changes(before, after)
    if not quiet:
        click.echo(found.summary())
    if folder is not None:
        found.report(folder)
