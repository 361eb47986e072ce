"""`gpmodel report`: the pages again, from saved results."""

from pathlib import Path

import click

from gpmodel.cli.options import quiet_option
from gpmodel.report.saved import read_report


@click.command()
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@quiet_option
def report(folder: Path, quiet: bool) -> None:
    """Write the pages, poses.csv and the figures again from DIR/report.json; nothing is fitted."""
    saved = read_report(folder)
    from gpmodel.report.write import write_report

    files = write_report(saved, folder)
    if not quiet:
        click.echo(f"{', '.join(file.name for file in files)} and the figures are in {folder}")
