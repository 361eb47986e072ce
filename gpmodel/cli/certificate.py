"""`gpmodel certificate`: how accurate the machine is, on paper."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import click

from gpmodel.cli.options import quiet_option
from gpmodel.files import write_text
from gpmodel.report.certificate import certificate as certify
from gpmodel.report.certificate import html
from gpmodel.report.particulars import Particulars, read_particulars
from gpmodel.report.saved import read_report


def particulars_options(command: Callable[..., None]) -> Callable[..., None]:
    """An option for each line of text on a certificate."""
    for field in reversed(fields(Particulars)):
        name = field.name.replace("_", " ")
        command = click.option(f"--{name.replace(' ', '-')}", default="", metavar="TEXT", help=f"The {name}.")(command)
    return command


@click.command()
@click.argument("result", metavar="DIR", type=click.Path(path_type=Path))
@click.option("--particulars", type=click.Path(path_type=Path), help="TOML file of the options below.")
@click.option("--out", "folder", type=click.Path(path_type=Path), default=None, help="[default: DIR]")
@particulars_options
@quiet_option
def certificate(result: Path, particulars: Path | None, folder: Path | None, quiet: bool, **given: str) -> None:
    """Write certificate.html and certificate.pdf of the calibration or discovery in DIR."""
    from gpmodel.report.certificate_pdf import write_pdf

    record = read_report(result)
    said = read_particulars(particulars) if particulars else Particulars()
    said = replace(said, **{name: value for name, value in given.items() if value})
    target = folder or result
    write_text(target / "certificate.html", html(record, said))
    write_pdf(certify(record, said), target / "certificate.pdf")
    if not quiet:
        click.echo(f"certificate.html and certificate.pdf are in {target}")
