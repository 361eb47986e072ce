"""`gpmodel check`: the table, judged."""

from pathlib import Path

import click

from gpmodel.api.check import check as judge
from gpmodel.api.table import read_table
from gpmodel.cli import options as shared
from gpmodel.cli.console import command_line, progress_line
from gpmodel.cli.terminal import echo
from gpmodel.mechanism.source import LoadedMechanism

UNFIT = 2
"""Exit status where nothing should be fitted to a table."""


@click.command()
@shared.table_argument
@shared.mechanism_options()
@shared.sights_options
@shared.standard_option
@shared.instrument_option
@shared.out_folder_option
@shared.quiet_option
def check(
    table: Path, mechanism: LoadedMechanism, standard: tuple[str, ...], instrument: str | None, folder: Path | None,
    quiet: bool, **sights: str | None,
) -> int:  # fmt: skip
    """Judge TABLE: units and columns mixed up, poses out of reach, alike, repeated or too few, jumps, outliers.

    Ends with status 2 where nothing should be fitted to the table. With --out: check.json.
    """
    with progress_line(quiet) as say:
        data = read_table(table, mechanism, in_order=False, **sights) if any(sights.values()) else table
        judged = judge(mechanism, data, standard=standard, instrument=instrument, progress=say, command=command_line())
    judged.refuse()
    if folder is not None:
        judged.report(folder)
    if not quiet:
        echo(judged.summary())
    return UNFIT if judged.unfit else 0
