"""`gpmodel compensate`: corrected joint values."""

from pathlib import Path

import click

from gpmodel.api.model import Point, load_model
from gpmodel.application.exports.programs import Language
from gpmodel.cli.console import session_note, write_frame
from gpmodel.cli.options import Number, in_order_option, quiet_option, seed_option, session_option
from gpmodel.files import write_text

WHICH = {"tool": "point", "frame": "origin"}
"""What of either is meant."""
PROGRAMS: dict[str, Language] = {".mod": "RAPID", ".dat": "KRL"}
"""What files of a robot's program are called."""


@click.command()
@click.argument("model", type=click.Path(path_type=Path))
@click.argument("targets", type=click.Path(path_type=Path))
@click.option("--max-move", type=Number(above=0.0), default=2.0, show_default=True, metavar="DEG",
              help="No joint is moved by more.")  # fmt: skip
@click.option("--point", type=click.Choice(["tool", "frame"]), default="tool", show_default=True,
              help="That x, y, z are of: the measured point, or the origin of the measured link (flange).")  # fmt: skip
@session_option
@in_order_option
@seed_option
@click.option("--out", type=click.Path(path_type=Path), default=None,
              help="A .csv file or a folder; .mod (RAPID) or .dat (KRL) of a program. [default: print]")  # fmt: skip
@quiet_option
def compensate(
    model: Path,
    targets: Path,
    max_move: float,
    point: Point,
    session: bool,
    in_order: bool,
    seed: int,
    out: Path | None,
    quiet: bool,
) -> None:
    """Joint values that make the real mechanism reach nominal TARGETS, a status per row.

    TARGETS: joint values, whose nominal tool pose is to be reached; or, without joint columns, x, y, z of --point
    in the mechanism's root frame, with rx, ry, rz for its whole pose. MODEL: model.json of calibrate or discover.
    Statuses with corrected values: ok; near singular (the position is reached, not all of the orientation); outside
    the measured range; side of play open (a joint with play comes from another side than without correction). Without:
    large move, joint limit, not reached.
    """
    fitted = load_model(model)
    corrected = fitted.compensate(
        targets, max_move=max_move, point=point, session=session, in_order=in_order, seed=seed
    )  # fmt: skip
    language = None if out is None else PROGRAMS.get(out.suffix.lower())
    path = out
    if out is not None and language:
        write_text(out, fitted.program(corrected, language, out.stem))
    else:
        path = write_frame(corrected, out, "compensated.csv", targets)
    if not quiet and fitted.of_its_session:
        click.echo(session_note(fitted.of_its_session, session), err=True)
    if not quiet and path is not None:
        counts = ", ".join(f"{count} {status}" for status, count in corrected["status"].value_counts().items())
        largest = corrected["correction [mm]"].max()
        moved = f"corrections of the {point} {WHICH[point]} up to {largest:.4f} mm"
        click.echo(f"{len(corrected)} targets in {path}: {counts}; {moved}")
