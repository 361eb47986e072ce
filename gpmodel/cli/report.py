"""`gpmodel report`: the pages again, from saved results."""

from pathlib import Path

import click

from gpmodel.cli.options import quiet_option
from gpmodel.report.saved import read_report


@click.command()
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@quiet_option
def report(folder: Path, quiet: bool) -> None:
    """Draw the figures and write report.html again from DIR/report.json; nothing is fitted."""
    saved = read_report(folder)
    from gpmodel.report.figures import write_figures
    from gpmodel.report.page import write_page

    figures = write_figures(saved, folder)
    page = write_page(saved, folder, figures)
    if not quiet:
        click.echo(f"{page} and {len(figures)} figures in {folder / 'figures'}")
