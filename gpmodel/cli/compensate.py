"""`gpmodel compensate`: corrected joint values."""

from pathlib import Path

import click

from gpmodel.api.model import load_model
from gpmodel.cli.console import session_note, write_frame
from gpmodel.cli.options import Number, in_order_option, out_file_option, quiet_option, seed_option, session_option


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("targets", type=click.Path(path_type=Path))
@click.option("--max-move", type=Number(above=0.0), default=2.0, show_default=True, metavar="DEG",
              help="No joint is moved by more.")  # fmt: skip
@session_option
@in_order_option
@seed_option
@out_file_option
@quiet_option
def compensate(
    model: Path, targets: Path, max_move: float, session: bool, in_order: bool, seed: int, out: Path | None, quiet: bool
) -> None:
    """Joint values that make the real mechanism reach nominal TARGETS, a status per row.

    TARGETS: joint values, whose nominal tool pose is to be reached; or, without joint columns, the tool's x, y, z
    in the mechanism's root frame, with rx, ry, rz for its whole pose. MODEL: model.json of calibrate or discover.
    Statuses with corrected values: ok; near singular (the position is reached, not all of the orientation); outside
    the measured range. Without: large move, joint limit, not reached.
    """
    fitted = load_model(model)
    corrected = fitted.compensate(targets, max_move=max_move, session=session, in_order=in_order, seed=seed)
    path = write_frame(corrected, out, "compensated.csv")
    if not quiet and fitted.of_its_session:
        click.echo(session_note(fitted.of_its_session, session), err=True)
    if not quiet and path is not None:
        counts = ", ".join(f"{count} {status}" for status, count in corrected["status"].value_counts().items())
        largest = corrected["correction [mm]"].max()
        click.echo(f"{len(corrected)} targets in {path}: {counts}; corrections up to {largest:.4f} mm")
