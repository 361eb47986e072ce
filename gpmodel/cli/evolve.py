"""`gpmodel evolve`: compensators or slot shapes by many runs, and the histogram of the inputs they refer to."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import click

from gpmodel.api.evolve import evolve as run
from gpmodel.api.evolve_settings import default_strategies
from gpmodel.api.table import read_table
from gpmodel.cli.console import command_line, progress_line
from gpmodel.cli.options import (
    Number,
    holdout_option,
    in_order_option,
    mechanism_options,
    out_folder_option,
    quiet_option,
    seed_option,
    standard_option,
    table_argument,
)
from gpmodel.errors import InputError
from gpmodel.evolution.representation import Representation, label
from gpmodel.mechanism.source import LoadedMechanism


@click.command()
@table_argument
@mechanism_options()
@click.option("--representation", default="linear,tree", show_default=True, help="linear, tree, or both.")
@click.option("--space", type=click.Choice(["cartesian", "slot"]), default="cartesian", show_default=True,
              help="Compensate the tip, or find the shape and the place of an effect.")  # fmt: skip
@click.option("--population", type=click.IntRange(4), default=None, help="[default: 65536 linear, 8192 tree]")
@click.option("--generations", type=click.IntRange(0), default=None, help="[default: 100]")
@click.option("--seconds", type=Number(above=0.0), default=None, help="Time a run, at most.")
@click.option("--runs", type=click.IntRange(1), default=5, show_default=True, help="Of each representation.")
@click.option("--operators", default=None, help="thesis, smooth, slot, physics, or names.")
@click.option("--norm", type=click.Choice(["max", "rms"]), default="max", show_default=True)
@standard_option
@holdout_option
@in_order_option
@click.option("--workers", "threads", type=click.IntRange(0), default=0,
              help="Threads; the numbers do not depend on it. [default: all cores]")  # fmt: skip
@click.option("--checkpoint", type=click.Path(path_type=Path, dir_okay=False), default=None,
              help="File that keeps finished runs; given again, the rest is done.")  # fmt: skip
@seed_option
@out_folder_option
@quiet_option
def evolve(
    table: Path, mechanism: LoadedMechanism, representation: str, space: Literal["cartesian", "slot"],
    population: int | None, generations: int | None, seconds: float | None, runs: int, operators: str | None,
    norm: Literal["max", "rms"], standard: tuple[str, ...], holdout: float, in_order: bool, threads: int,
    checkpoint: Path | None, seed: int, folder: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Evolve programs on what the standard model leaves of TABLE; count the inputs they refer to.

    Every run is done again on shuffled errors: an input counts only where it stands out of those.
    With --out: evolve.json, programs.txt, and report.html with what it is made of.
    """
    dataset = read_table(table, mechanism, in_order=in_order)
    with progress_line(quiet) as say:
        result = run(
            mechanism, dataset, strategies=strategies_named(representation, space, operators), space=space, runs=runs,
            population=population, generations=generations, seconds=seconds, norm=norm, standard=standard,
            holdout=holdout, threads=threads, seed=seed, checkpoint=checkpoint, progress=say, command=command_line(),
        )  # fmt: skip
    if not quiet:
        click.echo(result.summary())
    if folder is not None:
        result.report(folder)
        if not quiet:
            click.echo(f"evolve.json, programs.txt and report.html are in {folder}")


def strategies_named(
    names: str, space: Literal["cartesian", "slot"], operators: str | None
) -> tuple[Representation, ...]:
    """The representations of `linear,tree`, with other operators where given. Raises InputError for another name."""
    known = {label(strategy): strategy for strategy in default_strategies(space)}
    chosen: list[Representation] = []
    for name in (part.strip() for part in names.split(",")):
        if name not in known:
            raise InputError(f"{name!r}, expected {' or '.join(known)}", "representation")
        chosen.append(known[name] if operators is None else replace(known[name], operators=operators))
    return tuple(chosen)
