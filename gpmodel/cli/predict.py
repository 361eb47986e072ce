"""`gpmodel predict`: where the tool is now."""

from pathlib import Path

import click

from gpmodel.api.model import load_model
from gpmodel.cli.console import progress_line, session_note, write_frame
from gpmodel.cli.options import in_order_option, out_file_option, quiet_option, session_option


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("poses", type=click.Path(path_type=Path))
@click.option("--as-measured", is_flag=True,
              help="With the instrument's errors that were found: what it would read.")  # fmt: skip
@session_option
@in_order_option
@out_file_option
@quiet_option
def predict(
    model: Path, poses: Path, as_measured: bool, session: bool, in_order: bool, out: Path | None, quiet: bool
) -> None:
    """Add predicted x, y, z [mm] in the instrument's frame to a table of joint values: the tool as it is now, at the
    end of the session that was fitted, without the errors of the instrument.

    MODEL is a model.json of calibrate or discover. POSES keeps its columns; where it has x, y, z already, the
    prediction is added as predicted_x, predicted_y, predicted_z. sigma is the standard deviation of that point;
    `outside` names the inputs beyond the ranges the model was fitted in.
    """
    fitted = load_model(model)
    with progress_line(quiet) as say:
        predicted, error = fitted.judged(poses, as_measured, session, in_order, say)
        path = write_frame(predicted, out, "predicted.csv", poses)
    if quiet:
        return
    if fitted.of_its_session:
        click.echo(session_note(fitted.of_its_session, session), err=True)
    if path is not None:
        said = f"; against the table's own: mean {error.mean():.4f}, max {error.max():.4f} mm" if len(error) else ""
        beyond = int((predicted.filter(regex="outside$") != "").any(axis=1).sum())
        warned = f"; {beyond} of them outside the measured range" if beyond else ""
        click.echo(f"{len(predicted)} poses predicted in {path}{warned}{said}")
