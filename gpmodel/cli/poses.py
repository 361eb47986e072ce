"""`gpmodel poses`: where to measure."""

from pathlib import Path
from typing import Literal

import click

from gpmodel.api.poses import choose_poses
from gpmodel.cli.console import write_frame
from gpmodel.cli.options import mechanism_options, out_file_option, quiet_option, seed_option
from gpmodel.mechanism.source import LoadedMechanism


@click.command()
@mechanism_options()
@click.option("-n", "--count", default=40, show_default=True, type=click.IntRange(1), help="How many poses.")
@click.option("--criterion", type=click.Choice(["spread", "observability"]), default="spread", show_default=True)
@click.option("--above", default=None, metavar="HEIGHT", help="Lowest tip height over the root frame, as in 200mm.")
@seed_option
@out_file_option
@quiet_option
def poses(
    mechanism: LoadedMechanism, count: int, criterion: Literal["spread", "observability"], above: str | None, seed: int,
    out: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Joint values within the limits worth measuring at.

    spread: every pose as different from the others as possible (the equal distribution criterion). observability:
    the geometric errors as well determined as possible. Collisions are not known here: look before you move.
    """
    chosen = choose_poses(mechanism, count, criterion=criterion, above=above, seed=seed)
    path = write_frame(chosen.to_dataframe(), out, "poses.csv")
    if not quiet and path is not None:
        click.echo(f"{chosen.summary()}: {path}")
