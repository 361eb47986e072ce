"""`gpmodel poses`: where to measure."""

from pathlib import Path

import click
import numpy as np
import pandas as pd

from gpmodel.cli.console import write_frame
from gpmodel.cli.options import mechanism_options, out_file_option, quiet_option, seed_option
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.planning.poses import observable_poses, spacing, spread_poses
from gpmodel.table.units import parse_quantity
from gpmodel.table.write import joint_column


@click.command()
@mechanism_options
@click.option("-n", "--count", default=40, show_default=True, type=click.IntRange(1), help="How many poses.")
@click.option("--criterion", type=click.Choice(["spread", "observability"]), default="spread", show_default=True)
@click.option("--above", default=None, metavar="HEIGHT", help="Lowest tip height over the root frame, as in 200mm.")
@seed_option
@out_file_option
@quiet_option
def poses(
    choice: MechanismChoice, count: int, criterion: str, above: str | None, seed: int, out: Path | None, quiet: bool
) -> None:
    """Joint values within the limits worth measuring at.

    spread: every pose as different from the others as possible (the equal distribution criterion). observability:
    the geometric errors as well determined as possible. Collisions are not known here: look before you move.
    """
    mechanism = choice.load()
    plane = -np.inf if above is None else parse_quantity(above, "length", "--above")
    make = spread_poses if criterion == "spread" else observable_poses
    q = make(mechanism, count, np.random.default_rng(seed), plane)
    columns = [joint_column(j.name, j.kind, v) for j, v in zip(mechanism.joints, q.T, strict=True)]
    frame = pd.DataFrame({header: [f"{v:.6f}" for v in values] for header, values in columns})
    path = write_frame(frame, out, "poses.csv")
    if not quiet and path is not None:
        apart = f", no two closer than {spacing(mechanism, q):.2f} of a range" if count > 1 else ""
        click.echo(f"{count} poses in {path}{apart}")
