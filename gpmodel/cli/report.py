"""`gpmodel report`: the pages again, from saved results."""

import json
from pathlib import Path
from typing import Any

import click

from gpmodel.cli.options import quiet_option
from gpmodel.errors import InputError

RESULTS = "report.json"


def read_report(folder: Path) -> dict[str, Any]:
    """The saved results in `folder`. Raises InputError where there are none, or they are no report."""
    path = folder / RESULTS
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; expected one that discover or calibrate wrote with --out")
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{folder}: has no {RESULTS}; expected a folder that discover or calibrate wrote") from None
    except (ValueError, OSError) as error:
        raise InputError(
            f"{path}: cannot be read ({error}); expected the JSON that discover or calibrate wrote"
        ) from None
    if not isinstance(report, dict) or not isinstance(report.get("ladder"), list):
        raise InputError(f"{path}: has no 'ladder'; expected the JSON that discover or calibrate wrote")
    if report.get("schema") != 1:
        raise InputError(f"{path}: schema {report.get('schema')!r}; expected 1, the one this version reads")
    return report


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
