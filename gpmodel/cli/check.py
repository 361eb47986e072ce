"""Commands `gpmodel check`, `effects` and `completion`."""

import textwrap
from pathlib import Path

import click
from click.shell_completion import get_completion_class

from gpmodel.api.check import check as judge
from gpmodel.api.check import effects as families
from gpmodel.api.table import read_table
from gpmodel.cli import options as shared
from gpmodel.cli.console import command_line, deliver, path_for, progress_line
from gpmodel.cli.options import mechanism_options
from gpmodel.cli.terminal import echo
from gpmodel.errors import InputError
from gpmodel.files import write_text
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.table.cells import table_text
from gpmodel.wording import WIDTH, wrapped


@click.command()
@mechanism_options()
@shared.out_file_option
def effects(mechanism: LoadedMechanism, out: Path | None) -> None:
    """List the families of the effect catalogue: explanation, source, inputs, and an example on MECHANISM."""
    listed = families(mechanism)
    if out is not None:
        write_text(path_for(out, "effects.csv"), table_text(listed))
        return
    for row in listed.to_dict("records"):
        echo(row["family"])
        for line in (f"{row['explanation']} ({row['source']})", _instances(row)):
            echo(wrapped(line))


def _instances(row: dict[object, object]) -> str:
    if not row["instances"]:
        return f"none on this mechanism; required: {row['inputs'] or 'other joints'}"
    first, *others = textwrap.wrap(str(row["inputs"] or "nothing"), WIDTH, break_on_hyphens=False)
    reads = f"{first} ..." if others else first
    carrying = " with a payload" if row["payload"] else ""
    return f"{row['instances']} here{carrying}, reading {reads}; --effect '{row['example']}'"


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(context: click.Context, shell: str) -> None:
    """Print the shell code for completion of commands and options; activate with eval "$(gpmodel completion bash)"."""
    kind = get_completion_class(shell)
    if kind is None:
        raise InputError(f"{shell} is no shell that completion is made for, expected bash, zsh or fish", "shell")
    echo(kind(context.find_root().command, {}, "gpmodel", "_GPMODEL_COMPLETE").source())


UNFIT = 2
"""Exit status for a table that is not fit for calibration."""


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
    """Check TABLE: wrong units or columns, unreachable, similar, repeated or too few poses, jumps, outliers.

    The exit status is 2 if the table is not fit for calibration. With --out, gpmodel writes check.json.
    """
    with progress_line(quiet) as say:
        data = read_table(table, mechanism, in_order=False, **sights) if any(sights.values()) else table
        judged = judge(mechanism, data, standard=standard, instrument=instrument, progress=say, command=command_line())
    judged.refuse()
    deliver(judged, folder, quiet)
    return UNFIT if judged.unfit else 0
