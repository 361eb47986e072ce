"""Command `gpmodel calibrate`: fit registration, the standard model and named effects."""

from contextlib import nullcontext
from pathlib import Path

import click

from gpmodel.api.calibrate import CalibrationResult
from gpmodel.api.calibrate import calibrate as fit
from gpmodel.api.results import check_writable, write_numbers
from gpmodel.api.saved import load_result
from gpmodel.api.table import read_table
from gpmodel.characters import shell_quoted
from gpmodel.cli import options as shared
from gpmodel.cli.console import command_line, what_next
from gpmodel.cli.terminal import echo
from gpmodel.errors import InputError
from gpmodel.files import locked_folder
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.model.effect import Effect


@click.command()
@shared.table_argument
@shared.mechanism_options()
@click.option("--effect", "effects", multiple=True, metavar="NAME", help="'gear_harmonic J4', 'J4.moving:Rz:sin(J4)'.")
@click.option(
    "--findings", type=shared.PATH, metavar="RESULT", help="Result folder of discover, whose found effects are fitted."
)
@click.option("--formula", metavar="[N=]K", help="Use alternative formula K of finding N of --findings.")
@click.option("--fleet", type=shared.PATH, metavar="FLEET", help="fleet.json, a prior for a machine of its type.")
@shared.joints_option
@shared.sights_options
@shared.standard_option
@shared.condition_limit_option
@shared.holdout_option
@shared.instrument_option
@shared.in_order_option
@shared.seed_option
@shared.out_folder_option
@shared.quiet_option
def calibrate(
    table: Path, mechanism: LoadedMechanism, effects: tuple[str, ...], findings: Path | None, formula: str | None,
    fleet: Path | None,
    joints: tuple[str, ...], standard: tuple[str, ...],
    condition_limit: float | None, holdout: float, instrument: str | None, in_order: bool, seed: int,
    folder: Path | None, quiet: bool, **sights: str | None,
) -> None:  # fmt: skip
    """Fit registration, tool, geometric constants and named effects to TABLE; state the error after each step.

    The stated errors are errors on held-out poses; the saved model is fitted to all poses.
    With --out, gpmodel writes report.html with its figures, report.json, model.json.
    """
    missing = ""
    with nullcontext() if folder is None else locked_folder(folder):
        dataset = read_table(table, mechanism, in_order=in_order, **sights)
        every: list[str | Effect] = [*effects, *found_in(findings, formula)]
        result = fit(
            mechanism, dataset, every, standard=standard, condition_limit=condition_limit, holdout=holdout,
            instrument=instrument, seed=seed, fleet=fleet, joints=joints, command=command_line(),
        )  # fmt: skip
        if folder is not None:
            missing = save(result, folder)
    if not quiet:
        echo(result.summary())
        if folder is not None and not missing:
            echo(what_next(folder, result.record))
    if folder is not None and missing:
        echo(f"{folder} holds the model without pages: {missing}, then gpmodel report {shell_quoted(folder)}", err=True)


def found_in(folder: Path | None, formula: str | None) -> tuple[Effect, ...]:
    """Return the found effects of a result; `formula` K or N=K selects an alternative formula K (of finding N)."""
    if folder is None:
        if formula is not None:
            raise InputError("needs a result, expected --findings RESULT too", "formula")
        return ()
    finding, _, number = (formula or "").rpartition("=")
    if formula is None:
        return load_result(folder).effects()
    if not (number.isdecimal() and (finding.isdecimal() or not finding)):
        raise InputError(f"{formula!r}, expected K or N=K: 2, or 1=2", "formula")
    return load_result(folder).effects(int(number), int(finding) if finding else None)


def save(result: CalibrationResult, folder: Path) -> str:
    """Write the results into a folder; without the report extra, model.json and report.json only, and return the name
    of the missing extra."""
    try:
        check_writable()
    except InputError as error:
        write_numbers(result.record, result.model, folder)
        return error.said
    result.report(folder)
    return ""
