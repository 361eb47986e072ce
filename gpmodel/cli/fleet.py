"""Command `gpmodel fleet`: calibrate several machines of one type together."""

from pathlib import Path
from typing import Any

import click

from gpmodel.api.arguments import load_mechanism
from gpmodel.api.fleet import fleet as calibrate_fleet
from gpmodel.characters import shell_quoted
from gpmodel.cli import options as shared
from gpmodel.cli.console import command_line, progress_line
from gpmodel.cli.request import keeping, resume_option
from gpmodel.cli.terminal import echo
from gpmodel.cluster import scheduled
from gpmodel.discovery.search import Search
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.hierarchy.found import KeptMachines
from gpmodel.hierarchy.record import MACHINES, NAME, folder_of_tables
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.report.fleet import PAGE


@click.command()
@click.argument("tables", metavar="DIR", type=shared.PATH)
@shared.mechanism_options(required=False)
@click.option(
    "--effect",
    "effects",
    multiple=True,
    metavar="NAME",
    help="Effect, as in calibrate, or none. [default: selected by all machines]",
)
@shared.holdout_option
@shared.seed_option
@shared.workers_option
@shared.scheduler_option
@shared.out_folder_option
@resume_option(NAME)
@shared.quiet_option
def fleet(
    tables: Path, mechanism: LoadedMechanism | None, effects: tuple[str, ...], workers: int | None,
    scheduler: str | None, folder: Path | None, quiet: bool, **asked: Any,
) -> None:  # fmt: skip
    """Calibrate the machines whose tables are in DIR together: common parameters, spread between machines, each machine
    with the prior of the others, and outlying machines.

    DIR has one table per machine. DIR/fleet.toml may name the mechanism, and the serial number of each file; by default
    the file name is the serial number. With --out: fleet.html, machines/SERIAL/ with the page and model.json of each,
    and fleet.json, a prior for a further machine (calibrate --fleet).
    """
    if mechanism is None:
        mechanism = load_mechanism(folder_of_tables(tables).said_mechanism)
    if "none" in effects and len(effects) > 1:
        raise InputError("none together with other effects; expected none alone", "effects")
    named = [name for name in effects if name != "none"] if effects else None
    with (
        progress_line(quiet or named is not None) as say,
        scheduled(scheduler, workers or 0) as executor,
        keeping(KeptMachines, mechanism, (Search(), Criteria()), say) as journal,
    ):
        found = calibrate_fleet(
            mechanism, tables, named, **asked, executor=executor, journal=journal, progress=say,
            command=command_line(),
        )  # fmt: skip
        if folder is not None:
            found.report(folder)
    if not quiet:
        echo(found.summary())
        if folder is not None:
            echo(f"overview: {folder / PAGE}\nof each machine: {folder / MACHINES}/*/model.json")
            echo("next, for a further machine:")
            echo(f"  gpmodel calibrate TABLE --mechanism M --fleet {shell_quoted(folder / NAME)}")
