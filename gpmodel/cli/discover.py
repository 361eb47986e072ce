"""`gpmodel discover`: the whole loop, from a measured table to the report."""

import math
from pathlib import Path
from typing import Any

import click

from gpmodel.api.discover import ENOUGH_HELD, DiscoveryResult, check_split
from gpmodel.api.discover import discover as look
from gpmodel.api.table import read_table
from gpmodel.cli import options as shared
from gpmodel.cli.console import command_line, progress_line, what_next
from gpmodel.cli.evolve import strategies_named
from gpmodel.cli.options import SIGHTS
from gpmodel.cli.request import Request, Typed
from gpmodel.cli.terminal import echo
from gpmodel.cluster import scheduled
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.executor import Workers
from gpmodel.families.catalogue import catalogue
from gpmodel.files import folder_for
from gpmodel.hierarchy.record import fleet_file
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.progress import Progress, Say
from gpmodel.records.unfinished import RunFiles
from gpmodel.table.bundles import FOLDS, USUAL

FEW = math.ceil(ENOUGH_HELD / USUAL)
"""Poses below which every one is held out once."""


@click.command()
@click.argument("table", type=shared.PATH, required=False)
@shared.mechanism_options(required=False)
@click.option("--runs", type=click.IntRange(0), default=Search().runs, show_default=True,
              help="GP runs of each representation in a round; 0: catalogue, smooth terms, formulas.")  # fmt: skip
@shared.representation_option("linear")
@click.option("--minutes", "--stop-after", "minutes", type=shared.Number(above=0.0), metavar="T",
              help="Time after which no new round begins. [default: no limit]")  # fmt: skip
@shared.sights_options
@click.option("--holdout", type=float, metavar="SHARE",
              help=f"Fraction of poses held out. [default: {USUAL}; under {FEW}: --folds {FOLDS}]")  # fmt: skip
@click.option("--folds", type=click.IntRange(2), metavar="K",
              help="Cross-validation of the whole search in K folds.")  # fmt: skip
@shared.in_order_option
@click.option("--noise", metavar="SIZE", help="Standard deviation of one reading: 0.03mm, 0.1px.")
@shared.instrument_option
@shared.joints_option
@click.option("--like", metavar="DIR", help="Result of fleet: prior of a further machine of its type.")
@shared.condition_limit_option
@click.option("--no-catalogue", is_flag=True, help="Search without the families of the catalogue.")
@shared.seed_option
@shared.workers_option
@shared.scheduler_option
@click.option("--out", "folder", type=shared.PATH, help="Folder of the results. [default: discovery]")
@shared.resume_option
@shared.quiet_option
def discover(
    table: Path | None, mechanism: LoadedMechanism | None, workers: int | None, scheduler: str | None,
    folder: Path | None, resume: Path | None, quiet: bool, **asked: Any,
) -> None:  # fmt: skip
    """Find what the model of MECHANISM is missing on the poses of TABLE."""
    check_split(asked["holdout"], asked["folds"])
    asked["like"] = asked["like"] and str(fleet_file(Path(asked["like"])))
    request = Typed(table, mechanism, folder, resume, asked).request(settings())
    if request is None:
        return
    folder = folder_for(resume or folder or Path("discovery"))
    with progress_line(quiet) as say, scheduled(scheduler, workers or 0) as executor:
        found = discover_request(request, folder, say, executor)
    if not quiet:
        echo(found.summary())
        echo(what_next(folder, found.record))


def discover_request(request: Request, folder: Path, say: Say, executor: Workers) -> DiscoveryResult:
    """Run what was asked, keeping what is finished in `folder`, and leave the results there."""
    with request.kept_in(folder, say, RunFiles) as kept:
        found = looked(request, say, executor, kept)
        say(Progress("writing the report"))
        found.report(folder)
    return found


def settings() -> object:
    """Return the search settings that have no option."""
    return Search(), Criteria()


def search_of(request: Request, executor: Workers) -> Search:
    """Build the search from the options."""
    ends = None if request.minutes is None else 60 * request.minutes
    strategies = strategies_named(request.options["representation"], "slot")
    return Search(runs=request.options["runs"], strategies=strategies, stop_after=ends, executor=executor)


def looked(request: Request, say: Say, executor: Workers, kept: RunFiles | None) -> DiscoveryResult:
    """Run the request; finished runs are kept."""
    options, mechanism = request.options, request.choice.load()
    return look(
        mechanism,
        read_table(request.table, mechanism, in_order=options["in_order"], **{k: options.get(k) for k in SIGHTS}),
        holdout=options["holdout"],
        folds=options["folds"],
        seed=options["seed"],
        search=search_of(request, executor),
        candidates=() if options["no_catalogue"] else catalogue,
        condition_limit=options["condition_limit"],
        joints=options.get("joints", ()),
        like=options.get("like"),
        noise=options["noise"],
        instrument=options["instrument"],
        progress=say,
        kept=kept,
        command=command_line(),
    )
