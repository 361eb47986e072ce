"""Commands that search: discover, evolve and fleet."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import click

from gpmodel.api.arguments import load_mechanism
from gpmodel.api.discover import ENOUGH_HELD, DiscoveryResult, check_split
from gpmodel.api.discover import discover as look
from gpmodel.api.evolve import SPACES, Effort, Space, default_strategies, settings_for
from gpmodel.api.evolve import evolve as run
from gpmodel.api.fleet import fleet as calibrate_fleet
from gpmodel.api.table import read_table
from gpmodel.characters import shell_quoted
from gpmodel.cli import options as shared
from gpmodel.cli.console import command_line, deliver, progress_line, what_next
from gpmodel.cli.request import keeping, resume_option
from gpmodel.cli.terminal import echo
from gpmodel.cluster import scheduled
from gpmodel.discovery.search import Search
from gpmodel.errors import InputError
from gpmodel.evidence.criteria import Criteria
from gpmodel.evolution.representation import Representation, label
from gpmodel.evolution.settings import SelectionScheme, Tournament, Truncation
from gpmodel.families.catalogue import catalogue
from gpmodel.files import folder_for
from gpmodel.hierarchy.found import FindingsFile
from gpmodel.hierarchy.record import MACHINES, NAME, folder_of_tables
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.progress import Progress, Say
from gpmodel.records.unfinished import RunFiles
from gpmodel.report.fleet import PAGE
from gpmodel.table.blocks import FOLDS, USUAL

FEW = math.ceil(ENOUGH_HELD / USUAL)
"""Number of poses of a table below which cross-validation replaces held-out poses."""


@click.command()
@shared.table_argument
@shared.mechanism_options()
@click.option("--runs", type=click.IntRange(0), default=Search().runs, show_default=True,
              help="Runs of genetic programming per round and representation; 0: none.")  # fmt: skip
@shared.representation_option("linear")
@click.option("--minutes", "--stop-after", "minutes", type=shared.Number(above=0.0), metavar="T",
              help="Time after which no new round begins. [default: no limit]")  # fmt: skip
@shared.sights_options
@click.option("--holdout", type=float, metavar="SHARE",
              help=f"Fraction of poses held out. [default: {USUAL}; under {FEW}: --folds {FOLDS}]")  # fmt: skip
@click.option("--folds", type=click.IntRange(2), metavar="K",
              help="Cross-validation of the whole search in K folds.")  # fmt: skip
@shared.in_order_option
@click.option("--noise", metavar="SIZE", help="Standard deviation of one measured value: 0.03mm, 0.1px.")
@shared.instrument_option
@shared.joints_option
@click.option("--like", metavar="DIR", help="Result folder of fleet, as prior of a further machine of the type.")
@shared.condition_limit_option
@click.option("--no-catalogue", is_flag=True, help="Search without the families of the catalogue.")
@shared.seed_option
@shared.workers_option
@shared.scheduler_option
@click.option("--out", "folder", type=shared.PATH, default=Path("discovery"), show_default=True,
              help="Folder for the results.")  # fmt: skip
@resume_option()
@shared.quiet_option
def discover(
    table: Path, mechanism: LoadedMechanism, workers: int | None, scheduler: str | None, minutes: float | None,
    folder: Path, quiet: bool, **asked: Any,
) -> None:  # fmt: skip
    """Search TABLE for physical effects that the model of MECHANISM lacks, and confirm them on held-out poses."""
    check_split(asked["holdout"], asked["folds"])
    folder_for(folder)
    with (
        progress_line(quiet) as say,
        scheduled(scheduler, workers or 0) as executor,
        keeping(RunFiles, mechanism, (Search(), Criteria()), say) as kept,
    ):
        sights = {name: asked.pop(name) for name in shared.SIGHTS}
        dataset = read_table(table, mechanism, in_order=asked.pop("in_order"), **sights)
        search = Search(
            runs=asked.pop("runs"), strategies=strategies_named(asked.pop("representation"), "slot"),
            stop_after=None if minutes is None else 60 * minutes, executor=executor,
        )  # fmt: skip
        offered = () if asked.pop("no_catalogue") else catalogue
        found = look(
            mechanism, dataset, search=search, candidates=offered, **asked, progress=say, kept=kept,
            command=command_line(),
        )  # fmt: skip
        write_results(found, folder, say, workers or 0)
    if not quiet:
        echo(found.summary())
        echo(what_next(folder, found.record))


def write_results(found: DiscoveryResult, folder: Path, say: Say, workers: int = 0) -> None:
    """Announce and write the report of a search. workers: number of processes, as in `DiscoveryResult.report`."""
    say(Progress("writing the report"))
    found.report(folder, workers=workers)


VARIED = ("operators", "crossover", "mutation", "length", "depth")
"""Settings of a program representation that have a command-line option."""


@click.command()
@shared.table_argument
@shared.mechanism_options()
@click.option("--model", type=shared.PATH, help="Result or model.json to start from, in place of the standard model.")
@click.option(
    "--effect", "effects", multiple=True, metavar="NAME", help="Effect in the initial model, named as in calibrate."
)
@shared.representation_option("linear,tree")
@click.option("--space", type=click.Choice(["cartesian", "slot"]), default="cartesian", show_default=True,
              help="Compensate the tool point, or find basis function and slot of an effect.")  # fmt: skip
@click.option("--population", type=click.IntRange(4), help="Programs of a run. [default: 65536 linear, 8192 tree]")
@click.option("--generations", type=click.IntRange(0), help="Generations of a run. [default: 100]")
@click.option("--seconds", type=shared.Number(above=0.0), help="Time limit of a run of genetic programming, s.")
@click.option("--runs", type=click.IntRange(1), default=5, show_default=True, help="Runs per program representation.")
@click.option("--operators", help="Operator set (thesis, smooth, slot, physics) or operator names.")
@click.option("--truncation", type=shared.Number(above=0.0), help="Fraction of the population that breeds: 0.05.")
@click.option("--tournament", type=click.IntRange(1), help="Tournament size, instead of truncation.")
@click.option(
    "--crossover",
    type=click.FloatRange(0.0, 0.999),
    help="Crossover rate per element of a sequence; share of the offspring of trees.",
)
@click.option("--mutation", type=click.FloatRange(0.0, 0.999), help="Mutation rate per element of a sequence.")
@click.option("--length", type=int, help="Number of elements of an evolved sequence.")
@click.option("--depth", type=int, help="Largest depth of an evolved tree.")
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
    """Evolve programs on the residual of a model of TABLE, and count the inputs of the best programs.

    The model is the standard model, or is given by --model or --effect. Every run is repeated on permuted residuals. An
    input is significant if clearly more programs contain the input on the residual than on permuted residuals.
    With --out, gpmodel writes programs.txt, report.json and report.html.
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
        deliver(result, folder, quiet)
    if folder is not None and not quiet:
        echo(f"programs.txt and report.html are in {folder}")


def selection_of(truncation: float | None, tournament: int | None) -> SelectionScheme | None:
    """Return the selection scheme of --truncation or --tournament, None without both; raise InputError if both are
    given."""
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
    """Return the program representations named in a text such as `linear,tree`, with changed settings.

    Raises InputError for an unknown name, and for a setting that no selected representation has.
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


@click.command()
@click.argument("tables", metavar="DIR", type=shared.PATH)
@shared.mechanism_options(required=False)
@click.option(
    "--effect",
    "effects",
    multiple=True,
    metavar="NAME",
    help="Effect, as in calibrate, or none. [default: selected by all machines]",
)
@shared.holdout_option
@shared.seed_option
@shared.workers_option
@shared.scheduler_option
@shared.out_folder_option
@resume_option(NAME)
@shared.quiet_option
def fleet(
    tables: Path, mechanism: LoadedMechanism | None, effects: tuple[str, ...], workers: int | None,
    scheduler: str | None, folder: Path | None, quiet: bool, **asked: Any,
) -> None:  # fmt: skip
    """Calibrate the machines whose tables are in DIR together: common parameters, spread between machines, each machine
    with the prior of the others, and outlying machines.

    DIR has one table per machine. DIR/fleet.toml may name the mechanism, and the serial number of each file; by default
    the file name is the serial number. With --out: fleet.html, machines/SERIAL/ with the page and model.json of each,
    and fleet.json, a prior for a further machine (calibrate --fleet).
    """
    if mechanism is None:
        mechanism = load_mechanism(folder_of_tables(tables).said_mechanism)
    if "none" in effects and len(effects) > 1:
        raise InputError("none together with other effects; expected none alone", "effects")
    named = [name for name in effects if name != "none"] if effects else None
    with (
        progress_line(quiet or named is not None) as say,
        scheduled(scheduler, workers or 0) as executor,
        keeping(FindingsFile, mechanism, (Search(), Criteria()), say) as journal,
    ):
        found = calibrate_fleet(
            mechanism, tables, named, **asked, executor=executor, journal=journal, progress=say,
            command=command_line(),
        )  # fmt: skip
        deliver(found, folder, quiet)
    if folder is not None and not quiet:
        echo(f"overview: {folder / PAGE}\nof each machine: {folder / MACHINES}/*/model.json")
        echo("next, for a further machine:")
        echo(f"  gpmodel calibrate TABLE --mechanism M --fleet {shell_quoted(folder / NAME)}")
