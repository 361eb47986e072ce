"""Command `gpmodel evolve`: evolve compensators or basis functions, and count the inputs that their programs use."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import click

from gpmodel.api.evolve import SPACES, Effort, Space, default_strategies, settings_for
from gpmodel.api.evolve import evolve as run
from gpmodel.api.table import read_table
from gpmodel.cli import options as shared
from gpmodel.cli.console import command_line, progress_line
from gpmodel.cli.request import keeping, resume_option
from gpmodel.cli.terminal import echo
from gpmodel.cluster import scheduled
from gpmodel.errors import InputError
from gpmodel.evolution.representation import Representation, label
from gpmodel.evolution.settings import SelectionScheme, Tournament, Truncation
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.records.unfinished import RunFiles

VARIED = ("operators", "crossover", "mutation", "length", "depth")
"""Settings of a representation with an option of their own."""


@click.command()
@shared.table_argument
@shared.mechanism_options()
@click.option("--model", type=shared.PATH, help="Result or model.json to start from, in place of the standard model.")
@click.option(
    "--effect", "effects", multiple=True, metavar="NAME", help="Effect of the starting model, as in calibrate."
)
@shared.representation_option("linear,tree")
@click.option("--space", type=click.Choice(["cartesian", "slot"]), default="cartesian", show_default=True,
              help="Compensate the tool point, or find basis function and slot of an effect.")  # fmt: skip
@click.option("--population", type=click.IntRange(4), help="[default: 65536 linear, 8192 tree]")
@click.option("--generations", type=click.IntRange(0), help="[default: 100]")
@click.option("--seconds", type=shared.Number(above=0.0), help="Time limit of a run.")
@click.option("--runs", type=click.IntRange(1), default=5, show_default=True, help="Runs of each representation.")
@click.option("--operators", help="Operator set (thesis, smooth, slot, physics) or names.")
@click.option("--truncation", type=shared.Number(above=0.0), help="Fraction of the population that breeds: 0.05.")
@click.option("--tournament", type=click.IntRange(1), help="Tournament size, instead of truncation.")
@click.option(
    "--crossover",
    type=click.FloatRange(0.0, 0.999),
    help="Rate per element of a sequence; share of the offspring of trees.",
)
@click.option("--mutation", type=click.FloatRange(0.0, 0.999), help="Rate per element of a sequence.")
@click.option("--length", type=int, help="Elements of a sequence.")
@click.option("--depth", type=int, help="Largest depth of a tree.")
@click.option("--norm", type=click.Choice(["max", "rms"]), default="max", show_default=True)
@shared.sights_options
@shared.standard_option
@shared.holdout_option
@shared.in_order_option
@shared.seed_option
@shared.workers_option
@shared.scheduler_option
@shared.out_folder_option
@resume_option()
@shared.quiet_option
def evolve(
    table: Path, mechanism: LoadedMechanism, workers: int | None, scheduler: str | None, folder: Path | None,
    quiet: bool, **asked: Any,
) -> None:  # fmt: skip
    """Evolve programs on the residual of TABLE, and count the inputs that they use.

    The residual is that of the standard model, or of another model with --model or --effect. Every run is repeated on
    shuffled residuals; an input is significant if more programs use it than on shuffled residuals.
    With --out: programs.txt, report.json and report.html.
    """
    settings = [settings_for(space, default_strategies(space), Effort()) for space in SPACES]
    with (
        progress_line(quiet) as say,
        scheduled(scheduler, workers or 0) as executor,
        keeping(RunFiles, mechanism, settings, say) as kept,
    ):
        sights = {name: asked.pop(name) for name in shared.SIGHTS}
        dataset = read_table(table, mechanism, in_order=asked.pop("in_order"), **sights)
        names, *schemes = (asked.pop(name) for name in ("representation", "truncation", "tournament"))
        varied = {name: asked.pop(name) for name in VARIED}
        strategies = strategies_named(names, asked["space"], {k: v for k, v in varied.items() if v is not None})
        result = run(
            mechanism, dataset, strategies=strategies, selection=selection_of(*schemes), **asked,
            executor=executor, kept=kept, progress=say, command=command_line(),
        )  # fmt: skip
        if folder is not None:
            result.report(folder)
    if not quiet:
        echo(result.summary())
        if folder is not None:
            echo(f"programs.txt and report.html are in {folder}")


def selection_of(truncation: float | None, tournament: int | None) -> SelectionScheme | None:
    """Return the requested selection scheme, None without either option. Raises InputError for both options."""
    if truncation is not None and tournament is not None:
        raise InputError("cannot be combined with --tournament, expected one of the two", "truncation")
    try:
        if truncation is not None:
            return Truncation(truncation)
        return None if tournament is None else Tournament(tournament)
    except InputError as error:
        raise InputError(error.said, "tournament" if truncation is None else "truncation") from None


def strategies_named(
    names: str, space: Space, varied: Mapping[str, Any] = MappingProxyType({})
) -> tuple[Representation, ...]:
    """Return the representations of `linear,tree` with changed settings.

    Raises InputError for another name, and for a setting that none of the representations has.
    """
    known = {label(strategy): strategy for strategy in default_strategies(space)}
    chosen: list[Representation] = []
    for name in (part.strip() for part in names.split(",")):
        if name not in known or name in map(label, chosen):
            raise InputError(f"{name!r}, expected {' or '.join(known)}, each once", "representation")
        strategy = known[name]
        own = {choice: value for choice, value in varied.items() if hasattr(strategy, choice)}
        chosen.append(replace(strategy, **own))
    for choice in varied:
        if not any(hasattr(strategy, choice) for strategy in chosen):
            raise InputError(f"does not apply to {names}, expected a representation with this option", choice)
    return tuple(chosen)
