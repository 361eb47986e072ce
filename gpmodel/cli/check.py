"""`gpmodel check`: the table, judged."""

from pathlib import Path

import click

from gpmodel.checks.judge import check_dataset
from gpmodel.cli.console import command_line, console_for_text
from gpmodel.cli.options import mechanism_options, out_folder_option, quiet_option, seed_option, table_argument
from gpmodel.errors import InputError
from gpmodel.files import finished_folder, to_json
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.error_model import prepare
from gpmodel.model.geometric import standard_effects
from gpmodel.table.read import read_table

STYLE = {"error": "bold red", "warning": "yellow", "note": "dim"}


@click.command()
@table_argument
@mechanism_options
@click.option("--standard", multiple=True, default=("*",), metavar="PATTERN", help="Parameters to be fitted: 'J* R?'.")
@seed_option
@out_folder_option
@quiet_option
def check(
    table: Path,
    choice: MechanismChoice,
    standard: tuple[str, ...],
    seed: int,
    out: Path | None,
    quiet: bool,
) -> None:
    """Judge TABLE: units and columns mixed up, poses out of reach, alike, repeated or too few, jumps, outliers.

    Ends with status 2 where nothing should be fitted to the table. With --out: check.json.
    """
    mechanism = choice.load()
    dataset = read_table(table, mechanism, choice.payload)
    findings = check_dataset(mechanism, prepare(mechanism, dataset), standard_effects(mechanism, standard))
    errors = [f for f in findings if f.severity == "error"]
    if errors:
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        raise InputError(errors[0].text + more)
    if not quiet:
        console = console_for_text()
        console.print(f"{dataset.source}: {len(dataset)} poses of {mechanism.name}")
        for finding in findings:
            console.print(f"  {finding.severity:8}", finding.text, style=STYLE[finding.severity], soft_wrap=True)
        warned = sum(f.severity == "warning" for f in findings)
        console.print(f"fit to calibrate with; {warned or 'no'} warning{'' if warned == 1 else 's'}")
    if out is not None:
        with finished_folder(out) as folder:
            content = {
                "schema": 1,
                "command": command_line(),
                "data": {"file": dataset.source, "sha256": dataset.sha256, "poses": len(dataset)},
                "findings": [{"severity": f.severity, "text": f.text} for f in findings],
            }
            (folder / "check.json").write_text(to_json(content), encoding="utf-8")
