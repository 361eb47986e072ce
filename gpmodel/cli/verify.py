"""`gpmodel verify`: does the model still hold?"""

from pathlib import Path

import click

from gpmodel.api.verify import verify as judge
from gpmodel.cli.console import command_line, progress_line
from gpmodel.cli.options import in_order_option, out_folder_option, quiet_option, sights_options

CHANGED = 3
"""Status of a model that does not hold, or not within the tolerance."""


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("table", type=click.Path(path_type=Path))
@click.option("--tolerance", default=None, metavar="LENGTH", help="No row may be farther off: 0.1mm, 0.5px.")
@in_order_option
@sights_options
@out_folder_option
@quiet_option
def verify(
    model: Path, table: Path, tolerance: str | None, in_order: bool, folder: Path | None, quiet: bool,
    **sights: str | None,
) -> int:  # fmt: skip
    """Judge MODEL by a TABLE measured afterwards: it holds, the machine has drifted, or it is another machine.

    MODEL is a model.json of calibrate or discover. The registration is found anew, and where planes, points, a camera
    in the hall or a board on the table are; ten to twenty poses are enough.
    Says the error of every pose with and without the model beside what the model promises, and what changed: a zero, a
    tool point, an effect. Where TABLE has the corrected_J1, ... of compensate, the machine went there.
    Ends with status 0 where the model holds, 3 where it does not or a pose is beyond the tolerance.
    With --out: verify.html, verify.pdf, verify.csv, and verify.json, of which `certificate` makes a certificate.
    """
    with progress_line(quiet) as say:
        found = judge(
            model, table, tolerance=tolerance, in_order=in_order, progress=say, command=command_line(), **sights
        )
    if not quiet:
        click.echo(found.summary())
    if folder is not None:
        found.report(folder)
        if not quiet:
            click.echo(
                f"page: {folder / 'verify.html'}\nnext:\n  gpmodel certificate {folder}  the certificate of this"
            )
    return 0 if found.passed else CHANGED
