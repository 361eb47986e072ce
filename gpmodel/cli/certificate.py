"""`gpmodel certificate`: how accurate the machine is, on paper."""

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import click

from gpmodel.api.certificate import certificate as certify
from gpmodel.cli.options import quiet_option
from gpmodel.report.particulars import Particulars


def particulars_options(command: Callable[..., None]) -> Callable[..., None]:
    """An option for each line of text on a certificate."""
    for field in reversed(fields(Particulars)):
        name = field.name.replace("_", " ")
        command = click.option(f"--{name.replace(' ', '-')}", default="", metavar="TEXT", help=f"The {name}.")(command)
    return command


@click.command()
@click.argument("result", metavar="DIR", type=click.Path(path_type=Path))
@click.option("--particulars", type=click.Path(path_type=Path), help="TOML file of the options below.")
@click.option(
    "--tolerance", default=None, metavar="LENGTH", help="No pose may be off by more, as in 0.1mm: pass or fail."
)
@click.option("--out", "folder", type=click.Path(path_type=Path), default=None, help="[default: DIR]")
@particulars_options
@quiet_option
def certificate(
    result: Path, particulars: Path | None, tolerance: str | None, folder: Path | None, quiet: bool, **given: str
) -> None:
    """Write certificate.html and certificate.pdf of the calibration, discovery or verification in DIR.

    Where DIR holds a verification (verify.json), that is certified: it was measured afterwards. Of a calibration or
    a discovery the accuracy after is predicted, and the certificate says so. What is not given is left to fill in.
    """
    target = folder or result
    certify(result, particulars, tolerance=tolerance, **given).report(target)
    if not quiet:
        click.echo(f"certificate.html and certificate.pdf are in {target}")
