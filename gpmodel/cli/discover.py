"""Command `gpmodel discover`: search a measured table for missing effects, and write the report."""

import math
from collections.abc import Mapping
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
from gpmodel.cli.request import keeping, resume_option
from gpmodel.cli.terminal import echo
from gpmodel.cluster import scheduled
from gpmodel.discovery.search import Search
from gpmodel.evidence.criteria import Criteria
from gpmodel.executor import Workers
from gpmodel.families.catalogue import catalogue
from gpmodel.files import folder_for
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.progress import Progress, Say
from gpmodel.records.unfinished import RunFiles
from gpmodel.table.bundles import FOLDS, USUAL

FEW = math.ceil(ENOUGH_HELD / USUAL)
"""Number of poses below which cross-validation replaces held-out poses."""


@click.command()
@shared.table_argument
@shared.mechanism_options()
@click.option("--runs", type=click.IntRange(0), default=Search().runs, show_default=True,
              help="GP runs of each representation in a round; 0: no genetic programming.")  # fmt: skip
@shared.representation_option("linear")
@click.option("--minutes", "--stop-after", "minutes", type=shared.Number(above=0.0), metavar="T",
              help="Time after which no new round begins. [default: no limit]")  # fmt: skip
@shared.sights_options
@click.option("--holdout", type=float, metavar="SHARE",
              help=f"Fraction of poses held out. [default: {USUAL}; under {FEW}: --folds {FOLDS}]")  # fmt: skip
@click.option("--folds", type=click.IntRange(2), metavar="K",
              help="Cross-validation of the whole search in K folds.")  # fmt: skip
@shared.in_order_option
@click.option("--noise", metavar="SIZE", help="Standard deviation of one measurement: 0.03mm, 0.1px.")
@shared.instrument_option
@shared.joints_option
@click.option("--like", metavar="DIR", help="Result of fleet: prior of a further machine of its type.")
@shared.condition_limit_option
@click.option("--no-catalogue", is_flag=True, help="Search without the families of the catalogue.")
@shared.seed_option
@shared.workers_option
@shared.scheduler_option
@click.option("--out", "folder", type=shared.PATH, default=Path("discovery"), show_default=True,
              help="Folder of the results.")  # fmt: skip
@resume_option()
@shared.quiet_option
def discover(
    table: Path, mechanism: LoadedMechanism, workers: int | None, scheduler: str | None, minutes: float | None,
    folder: Path, quiet: bool, **asked: Any,
) -> None:  # fmt: skip
    """Find effects that the model of MECHANISM lacks, from the poses of TABLE."""
    check_split(asked["holdout"], asked["folds"])
    folder_for(folder)
    with (
        progress_line(quiet) as say,
        scheduled(scheduler, workers or 0) as executor,
        keeping(RunFiles, mechanism, (Search(), Criteria()), say) as kept,
    ):
        found = looked(mechanism, table, asked, say, search_of(asked, minutes, executor), kept)
        write_results(found, folder, say, workers or 0)
    if not quiet:
        echo(found.summary())
        echo(what_next(folder, found.record))


def write_results(found: DiscoveryResult, folder: Path, say: Say, workers: int = 0) -> None:
    """Announce the report and write it. workers: as in `DiscoveryResult.report`."""
    say(Progress("writing the report"))
    found.report(folder, workers=workers)


def search_of(asked: Mapping[str, Any], minutes: float | None, executor: Workers) -> Search:
    """Return the search of the options. minutes: time after which no new round begins."""
    strategies = strategies_named(asked["representation"], "slot")
    ends = None if minutes is None else 60 * minutes
    return Search(runs=asked["runs"], strategies=strategies, stop_after=ends, executor=executor)


def looked(
    mechanism: LoadedMechanism, table: Path, asked: Mapping[str, Any], say: Say, search: Search,
    kept: RunFiles | None = None,
) -> DiscoveryResult:  # fmt: skip
    """Run the discovery of the options; finished runs are saved."""
    return look(
        mechanism,
        read_table(table, mechanism, in_order=asked["in_order"], **{k: asked.get(k) for k in SIGHTS}),
        holdout=asked["holdout"],
        folds=asked["folds"],
        seed=asked["seed"],
        search=search,
        candidates=() if asked["no_catalogue"] else catalogue,
        condition_limit=asked["condition_limit"],
        joints=asked.get("joints", ()),
        like=asked.get("like"),
        noise=asked["noise"],
        instrument=asked["instrument"],
        progress=say,
        kept=kept,
        command=command_line(),
    )
