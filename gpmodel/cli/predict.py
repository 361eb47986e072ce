"""`gpmodel predict`: what the instrument would read."""

from pathlib import Path

import click

from gpmodel.api.model import load_model
from gpmodel.cli.console import write_frame
from gpmodel.cli.options import out_file_option, quiet_option


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("poses", type=click.Path(path_type=Path))
@out_file_option
@quiet_option
def predict(model: Path, poses: Path, out: Path | None, quiet: bool) -> None:
    """Add predicted x, y, z [mm] in the instrument's frame to a table of joint values.

    MODEL is a model.json of calibrate or discover. POSES keeps its columns; where it has x, y, z already, the
    prediction is added as predicted_x, predicted_y, predicted_z.
    """
    fitted = load_model(model)
    predicted = fitted.predict(poses)
    path = write_frame(predicted, out, "predicted.csv")
    if quiet:
        return
    if fitted.reads_rows:
        click.echo(f"{poses}: the model reads row; row k is taken for row k of the session it was fitted to", err=True)
    if path is not None:
        error = fitted.misses(poses)
        said = f"; against the table's own: mean {error.mean():.4f}, max {error.max():.4f} mm" if len(error) else ""
        click.echo(f"{len(predicted)} poses predicted in {path}{said}")
