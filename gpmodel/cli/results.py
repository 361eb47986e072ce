"""Commands on a result folder: report, compare, explain, certificate."""

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import click

from gpmodel.api.certificate import certificate as certify
from gpmodel.api.saved import compare as changes
from gpmodel.api.saved import explain as finding
from gpmodel.cli.console import deliver
from gpmodel.cli.options import PATH, page_option, quiet_option
from gpmodel.cli.terminal import echo
from gpmodel.report.origin import Particulars
from gpmodel.report.saved import read_report


@click.command()
@click.argument("result", metavar="DIR", type=PATH)
@click.option("--out", "folder", type=PATH, help="Folder of the pages. [default: DIR]")
@quiet_option
def report(result: Path, folder: Path | None, quiet: bool) -> None:
    """Write the pages, poses.csv and the figures again from DIR/report.json, without a fit."""
    saved = read_report(result)
    from gpmodel.report.write import write_report

    target = folder or result
    files = write_report(saved, target)
    if not quiet:
        echo(f"{', '.join(file.name for file in files)} and the figures are in {target}")


@click.command()
@click.argument("before", metavar="A", type=PATH)
@click.argument("after", metavar="B", type=PATH)
@page_option
@quiet_option
def compare(before: Path, after: Path, folder: Path | None, quiet: bool) -> None:
    """List the change of each parameter and effect between the calibrations in folders A and B."""
    deliver(changes(before, after), folder, quiet)


@click.command()
@click.argument("result", metavar="DIR", type=PATH)
@click.argument("number", metavar="N", type=click.IntRange(1))
@page_option
@quiet_option
def explain(result: Path, number: int, folder: Path | None, quiet: bool) -> None:
    """Explain finding N of the results in DIR: site, size at the tool, possible causes, and further measurements."""
    deliver(finding(result, number), folder, quiet)


def particulars_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add an option for each text field of a certificate."""
    for field in reversed(fields(Particulars)):
        name = field.name.replace("_", " ")
        command = click.option(f"--{name.replace(' ', '-')}", default="", metavar="TEXT", help=f"The {name}.")(command)
    return command


@click.command()
@click.argument("result", metavar="DIR", type=PATH)
@click.option("--particulars", type=PATH, help="TOML file with the fields of the certificate.")
@click.option("--tolerance", metavar="LENGTH", help="Largest admissible error of a pose, as in 0.1mm.")
@click.option("--out", "folder", type=PATH, help="Folder of the certificate. [default: DIR]")
@particulars_options
@quiet_option
def certificate(
    result: Path, particulars: Path | None, tolerance: str | None, folder: Path | None, quiet: bool, **given: str
) -> None:
    """Write certificate.html, a page to print, of the calibration, discovery or verification in DIR.

    If DIR has a verification (verify.json), the verification is certified, because the accuracy of a verification is
    measured. The accuracy after a calibration or a discovery is predicted, and the certificate states so. Fields
    without a value stay blank.
    """
    target = folder or result
    certify(result, particulars, tolerance=tolerance, **given).report(target)
    if not quiet:
        echo(f"page to print: {target / 'certificate.html'}")
