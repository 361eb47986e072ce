"""`gpmodel simulate`: a measured table with known truth."""

from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from gpmodel.application.model_file import SavedModel, model_text
from gpmodel.arrays import Array
from gpmodel.cli.console import command_line, write_frame
from gpmodel.cli.options import mechanism_options, out_file_option, quiet_option, seed_option
from gpmodel.errors import InputError
from gpmodel.files import write_text
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.mechanism.workspace import random_poses
from gpmodel.planning.simulate import random_tool_point
from gpmodel.planning.simulate import simulate as run
from gpmodel.table.units import convert, known_unit, parse_quantity, split_header
from gpmodel.table.write import frame_of


def drawn(text: str, count: int, rng: np.random.Generator) -> tuple[str, str, Array]:
    """Name, unit and values (count,) of `NAME [UNIT]=A:B`, uniform from A to B, or `=A|B|C`, one of them a row.

    Raises InputError for anything else.
    """
    header, found, values = text.partition("=")
    name, unit = split_header(header)
    if not found or unit is None or not known_unit(unit):
        raise InputError(f"--input '{text}': expected 'NAME [UNIT]=A:B' or '=A|B', as in 'temperature [degC]=20:30'")
    where = f"--input '{text}'"
    if ":" in values:
        low, high = (convert(v, unit, where) for v in values.split(":", 1))
        return name, unit, rng.uniform(low, high, count)
    return name, unit, rng.choice([convert(v, unit, where) for v in values.split("|")], count)


@click.command()
@mechanism_options
@click.option("--effect", "effects", multiple=True, metavar="NAME=VALUE", help="'gear_harmonic J4=20 arcsec'.")
@click.option("--poses", default=90, show_default=True, type=click.IntRange(1), help="Random poses within the limits.")
@click.option("--noise", default="0.03mm", show_default=True, help="Standard deviation of each of x, y, z.")
@click.option("--geometry-sigma", default="0mm", show_default=True, help="Of every constant error; mrad per mm.")
@click.option("--input", "inputs", multiple=True, metavar="COLUMN", help="'temperature [degC]=20:30'.")
@seed_option
@out_file_option
@quiet_option
def simulate(
    choice: MechanismChoice,
    effects: tuple[str, ...],
    poses: int,
    noise: str,
    geometry_sigma: str,
    inputs: tuple[str, ...],
    seed: int,
    out: Path | None,
    quiet: bool,
) -> None:
    """A table of poses measured on a mechanism with known errors, and the truth beside it.

    The truth (NAME.truth.json) is a model `predict` and `compensate` read. NAME of an effect is a catalogue
    name or slot:axis:expression. Without --out the table is printed and there is no truth file.
    """
    rng = np.random.default_rng(seed)
    mechanism = choice.load()
    columns = [drawn(text, poses, rng) for text in inputs]
    payload = next((v for n, _, v in columns if n == "payload"), None)
    if payload is None and choice.payload is not None:
        payload = np.full(poses, choice.payload)
    tool_point = random_tool_point(rng)
    if payload is not None and choice.payload_com is None:
        choice = replace(choice, payload_com=tuple(tool_point.tolist()))
        mechanism = choice.load()
    spread = parse_quantity(noise, "length", "--noise")
    made = run(
        mechanism,
        random_poses(mechanism, poses, rng),
        effects,
        rng,
        noise=spread,
        geometry_sigma=parse_quantity(geometry_sigma, "length", "--geometry-sigma"),
        payload=payload,
        inputs={n: v for n, _, v in columns if n != "payload"},
        input_units={n: u for n, u, _ in columns if n != "payload"},
        tool_point=tool_point,
    )
    path = write_frame(frame_of(made.dataset, mechanism), out, "simulated.csv")
    if path is None:
        return
    count = len(made.theta)
    truth = SavedModel(
        choice=choice,
        model=made.model,
        theta=made.theta,
        stderr=np.full(count, np.nan),
        covariance=np.zeros((count, count)),
        placement=made.placement,
        lever=1.0,
        sigma=spread,
        pose=False,
        input_units=dict(made.dataset.extra_units),
    )
    truth_path = path.with_suffix(".truth.json")
    write_text(truth_path, model_text(truth, command=command_line(), seed=seed))
    if not quiet:
        click.echo(f"{poses} poses in {path}, the truth in {truth_path}")
