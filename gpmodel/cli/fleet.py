"""`gpmodel fleet`: many machines of one type."""

from pathlib import Path

import click

from gpmodel.api.fleet import fleet as calibrate_fleet
from gpmodel.cli.console import command_line, progress_line
from gpmodel.cli.options import (
    holdout_option,
    mechanism_options,
    out_folder_option,
    quiet_option,
    scheduler_option,
    seed_option,
    workers_option,
)
from gpmodel.executor import scheduled
from gpmodel.hierarchy.record import NAME
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.report.fleet import PAGE


@click.command()
@click.argument("tables", metavar="DIR", type=click.Path(path_type=Path))
@mechanism_options(required=False)
@click.option(
    "--effect", "effects", multiple=True, metavar="NAME", help="As of calibrate, or none. [default: found on most]"
)
@holdout_option
@seed_option
@workers_option
@scheduler_option
@out_folder_option
@quiet_option
def fleet(
    tables: Path, mechanism: LoadedMechanism | None, effects: tuple[str, ...], holdout: float, seed: int,
    workers: int | None, scheduler: str | None, folder: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Calibrate the machines whose tables are in DIR together: what the type has in common, how its machines spread,
    each with the others' help, and which of them stands out in what.

    A table a machine. DIR/fleet.toml may say the mechanism of all, and their serials by file; else a machine is called
    as its file. With --out: fleet.html, and fleet.json, which calibrate --fleet takes for a further machine.
    """
    named = None if not effects else [name for name in effects if name != "none"]
    with progress_line(quiet or named is not None) as say, scheduled(scheduler, workers or 0) as executor:
        found = calibrate_fleet(
            mechanism, tables, named, holdout=holdout, seed=seed, executor=executor, progress=say,
            command=command_line(),
        )  # fmt: skip
    if not quiet:
        click.echo(found.summary())
    if folder is not None:
        found.report(folder)
        if not quiet:
            click.echo(f"overview: {folder / PAGE}\nnext, of a further machine:")
            click.echo(f"  gpmodel calibrate TABLE --mechanism M --fleet {folder / NAME}")
