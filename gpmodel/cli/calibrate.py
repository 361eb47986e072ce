"""`gpmodel calibrate`: registration, the standard model and the effects named, before and after."""

from pathlib import Path

import click

from gpmodel.api.calibrate import calibrate as fit
from gpmodel.api.results import check_writable
from gpmodel.api.table import read_table
from gpmodel.cli.console import command_line, what_next
from gpmodel.cli.options import (
    holdout_option,
    in_order_option,
    instrument_option,
    joints_option,
    mechanism_options,
    out_folder_option,
    quiet_option,
    seed_option,
    sights_options,
    standard_option,
    table_argument,
)
from gpmodel.mechanism.source import LoadedMechanism


@click.command()
@table_argument
@mechanism_options()
@click.option("--effect", "effects", multiple=True, metavar="NAME", help="'gear_harmonic J4', 'J4.moving:Rz:sin(J4)'.")
@click.option(
    "--fleet", type=click.Path(path_type=Path), metavar="FLEET", help="fleet.json of its type: what is known."
)
@joints_option
@sights_options
@standard_option
@click.option("--condition-limit", type=float, help="Of the standard model. [default: cross-validated]")
@holdout_option
@instrument_option
@in_order_option
@seed_option
@out_folder_option
@quiet_option
def calibrate(
    table: Path, mechanism: LoadedMechanism, effects: tuple[str, ...], fleet: Path | None,
    joints: tuple[str, ...], standard: tuple[str, ...],
    condition_limit: float | None, holdout: float, instrument: str | None, in_order: bool, seed: int,
    folder: Path | None, quiet: bool, **sights: str | None,
) -> None:  # fmt: skip
    """Fit registration, tool, the standard model and the named effects to TABLE; say what it gained.

    Errors are of poses held out of the fit; the saved model is fitted to all poses.
    With --out: report.html with its figures, report.json, model.json.
    """
    if folder is not None:
        check_writable()
    dataset = read_table(table, mechanism, in_order=in_order, **sights)
    result = fit(
        mechanism, dataset, effects, standard=standard, condition_limit=condition_limit, holdout=holdout,
        instrument=instrument, seed=seed, fleet=fleet, joints=joints, command=command_line(),
    )  # fmt: skip
    if not quiet:
        click.echo(result.summary())
    if folder is not None:
        result.report(folder)
        if not quiet:
            click.echo(what_next(folder, result.record))
