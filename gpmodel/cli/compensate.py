"""`gpmodel compensate`: corrected joint values."""

from pathlib import Path

import click

from gpmodel.api.model import load_model
from gpmodel.cli.console import write_frame
from gpmodel.cli.options import out_file_option, quiet_option, seed_option


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("targets", type=click.Path(path_type=Path))
@seed_option
@out_file_option
@quiet_option
def compensate(model: Path, targets: Path, seed: int, out: Path | None, quiet: bool) -> None:
    """Joint values that make the real mechanism reach nominal TARGETS, a status per row.

    TARGETS: joint values, whose nominal tool pose is to be reached; or, without joint columns, the tool's x, y, z
    in the mechanism's root frame, with rx, ry, rz for its whole pose. MODEL: model.json of calibrate or discover.
    Rows whose status is not ok have no corrected values.
    """
    corrected = load_model(model).compensate(targets, seed=seed)
    path = write_frame(corrected, out, "compensated.csv")
    if not quiet and path is not None:
        reached = int((corrected["status"] == "ok").sum())
        click.echo(f"{reached} of {len(corrected)} targets reached in {path}")
