"""`gpmodel discover`: the whole loop, from a measured table to the report."""

import contextlib
import dataclasses
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from gpmodel.api.discover import DiscoveryResult
from gpmodel.api.discover import discover as look
from gpmodel.api.table import read_table
from gpmodel.cli.console import command_line, progress_line, what_next
from gpmodel.cli.options import (
    Number,
    holdout_option,
    in_order_option,
    mechanism_options,
    quiet_option,
    seed_option,
    workers_option,
)
from gpmodel.discovery import checkpoint
from gpmodel.discovery.result import Finding, Round
from gpmodel.discovery.search import Mapper, Search
from gpmodel.errors import InputError
from gpmodel.families.catalogue import catalogue
from gpmodel.files import folder_for
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice
from gpmodel.progress import Progress, Say

Finished = tuple[Sequence[Finding], Sequence[Round]]


@click.command()
@click.argument("table", type=click.Path(path_type=Path), required=False)
@mechanism_options(required=False)
@click.option("--runs", type=click.IntRange(1), default=Search().runs, show_default=True,
              help="How hard to look: GP runs of each representation in a round.")  # fmt: skip
@click.option("--minutes", "--stop-after", "minutes", type=Number(above=0.0), default=None, metavar="T",
              help="After T minutes no new round begins; what is found is reported. [default: no limit]")  # fmt: skip
@holdout_option
@in_order_option
@click.option("--noise", default=None, metavar="LENGTH", help="Standard deviation of one coordinate, as in 0.03mm.")
@click.option("--condition-limit", type=float, default=None, help="Of the standard model. [default: cross-validated]")
@click.option("--no-catalogue", is_flag=True, help="Offer no named family: what is found is what was evolved.")
@seed_option
@workers_option
@click.option("--scheduler", default=None, metavar="ADDRESS",
              help="A running dask scheduler that the GP runs go to, as in tcp://host:8786.")  # fmt: skip
@click.option("--out", "folder", type=click.Path(path_type=Path), default=None,
              help="Folder of the results. [default: discovery]")  # fmt: skip
@click.option("--resume", type=click.Path(path_type=Path), default=None,
              help="Folder of an interrupted run to go on with.")  # fmt: skip
@quiet_option
def discover(
    table: Path | None, mechanism: LoadedMechanism | None, workers: int | None, scheduler: str | None,
    folder: Path | None, resume: Path | None, quiet: bool, **asked: Any,
) -> None:  # fmt: skip
    """Find what the model of MECHANISM is missing on the poses of TABLE."""
    finished: Finished = ((), ())
    request: dict[str, Any] = asked | {
        "table": None if table is None else str(table.resolve()),
        "choice": None if mechanism is None else dataclasses.asdict(mechanism.choice),
    }
    if resume is not None:
        request, findings, rounds = checkpoint.load(resume)
        finished = findings, rounds
        folder = folder or resume
    if request["table"] is None or request["choice"] is None:
        raise InputError("discover: expected a TABLE and --mechanism M, or --resume DIR")
    folder = folder_for(folder or Path("discovery"))
    with progress_line(quiet) as say, cluster(scheduler) as mapper:
        found = discover_request(request, folder, say, workers, finished, mapper)
    if not quiet:
        click.echo(found.summary())
        click.echo(what_next(folder, found.record))


def discover_request(
    request: dict[str, Any], folder: Path, say: Say, workers: int | None = None, finished: Finished = ((), ()),
    mapper: Mapper | None = None,
) -> DiscoveryResult:  # fmt: skip
    """Run what was asked, keeping what is finished in `folder`, and leave the results there.

    request: table, choice (of the mechanism) and the options of `discover` that change its numbers.
    """
    minutes = request["minutes"]
    mechanism = MechanismChoice(**request["choice"]).load()
    found = look(
        mechanism,
        read_table(request["table"], mechanism, in_order=request["in_order"]),
        holdout=request["holdout"],
        seed=request["seed"],
        search=Search(
            runs=request["runs"], stop_after=None if minutes is None else 60 * minutes,
            workers=workers or os.cpu_count() or 1, mapper=mapper,
        ),
        candidates=() if request["no_catalogue"] else catalogue,
        condition_limit=request["condition_limit"],
        noise=request["noise"],
        progress=say,
        keep=lambda findings, rounds: checkpoint.save(folder, request, findings, rounds),
        resume=finished,
        command=command_line(),
    )  # fmt: skip
    say(Progress("writing the report"))
    found.report(folder)
    (folder / checkpoint.NAME).unlink(missing_ok=True)
    return found


@contextlib.contextmanager
def cluster(address: str | None) -> Iterator[Mapper | None]:
    """Where GP runs go: here, or to a dask scheduler. Raises InputError when dask or the scheduler is not there."""
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError("needs dask; pip install 'gpmodel[cluster]'", "scheduler") from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(f"no dask scheduler answers at {address} ({error})", "scheduler") from None
    with client:
        yield client.get_executor().map
