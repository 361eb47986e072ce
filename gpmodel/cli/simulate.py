"""`gpmodel simulate`: a measured table with known truth."""

from pathlib import Path

import click

from gpmodel.api.simulate import simulate as measure
from gpmodel.cli.console import command_line, place_for, write_frame
from gpmodel.cli.options import mechanism_options, out_file_option, quiet_option, seed_option
from gpmodel.cli.terminal import echo
from gpmodel.errors import InputError
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.planning.scenes import INSTRUMENTS


@click.command()
@mechanism_options()
@click.option("--effect", "effects", multiple=True, metavar="NAME=VALUE", help="'gear_harmonic J4=20 arcsec'.")
@click.option("--poses", default=90, show_default=True, type=click.IntRange(1), help="Random poses within the limits.")
@click.option("--noise", help="Standard deviation of one reading. [default: 0.03mm, 0.1px, 0.002deg]")
@click.option("--instrument", default="tracker", show_default=True, type=click.Choice(INSTRUMENTS), help="Instrument.")
@click.option(
    "--geometry-sigma", default="0mm", show_default=True, help="Standard deviation of constant errors; mrad per mm."
)
@click.option("--input", "inputs", multiple=True, metavar="COLUMN", help="'temperature [degC]=20:30', or '=20|30'.")
@seed_option
@out_file_option
@quiet_option
def simulate(
    mechanism: LoadedMechanism, effects: tuple[str, ...], poses: int, noise: str | None, instrument: str,
    geometry_sigma: str,    inputs: tuple[str, ...], seed: int, out: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """A table of poses measured on a mechanism with known errors, and the truth beside it.

    The truth (NAME.truth.json) is a model `predict` and `compensate` read. NAME of an effect is a catalogue
    name or slot:axis:expression. Without --out the table is printed and there is no truth file.
    """
    path = place_for(out, "simulated.csv")
    made = measure(
        mechanism, effects, poses=poses, noise=noise, instrument=instrument, geometry_sigma=geometry_sigma, 
        inputs=dict(map(_input, inputs)), seed=seed,
    )  # fmt: skip
    if path is None:
        write_frame(made.to_dataframe(), None, "")
        return
    truth = made.save(path, command=command_line(), seed=seed)
    if not quiet:
        echo(f"{poses} poses in {path}, the truth in {truth}")


def _input(text: str) -> tuple[str, str]:
    header, found, values = text.partition("=")
    if not found:
        raise InputError(f"'{text}', expected 'NAME [UNIT]=A:B' or '=A|B', as in 'temperature [degC]=20:30'", "inputs")
    return header, values
