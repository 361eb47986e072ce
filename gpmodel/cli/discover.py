"""`gpmodel discover`: the whole loop, from a measured table to the report."""

import contextlib
import dataclasses
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from gpmodel.api.calibrate import sound_poses
from gpmodel.application.model_file import save_model, saved_model
from gpmodel.cli.console import command_line
from gpmodel.cli.options import mechanism_options, quiet_option, seed_option, workers_option
from gpmodel.discovery import checkpoint
from gpmodel.discovery.loop import discover as run_loop
from gpmodel.discovery.result import Discovery, Finding, Round
from gpmodel.discovery.search import Mapper, Search
from gpmodel.errors import InputError
from gpmodel.files import finished_folder, write_text
from gpmodel.mechanism.source import LoadedMechanism, MechanismChoice
from gpmodel.report.figures import write_figures
from gpmodel.report.from_discovery import from_discovery
from gpmodel.report.origin import Origin
from gpmodel.report.page import write_page
from gpmodel.report.saved import to_json
from gpmodel.report.schema import Report
from gpmodel.table.split import hold_out
from gpmodel.table.units import parse_quantity

RUNS_A_MINUTE = 4


@click.command()
@click.argument("table", type=click.Path(path_type=Path), required=False)
@mechanism_options(required=False)
@click.option("--minutes", type=click.FloatRange(0.1), default=1.0, show_default=True,
              help="How hard to look: GP runs grow with it, and no round starts after ten times as long.")  # fmt: skip
@click.option("--holdout", default=0.3, show_default=True, help="Share of the poses nothing is chosen on.")
@click.option("--noise", default=None, metavar="LENGTH", help="The instrument's standard deviation of one coordinate.")
@click.option("--condition-limit", type=float, default=None, help="Of the standard model. [default: cross-validated]")
@seed_option
@workers_option
@click.option("--scheduler", default=None, metavar="ADDRESS",
              help="A running dask scheduler that the GP runs go to, as in tcp://host:8786.")  # fmt: skip
@click.option(
    "--out", type=click.Path(path_type=Path), default=None, help="Folder of the results. [default: discovery]"
)
@click.option(
    "--resume", type=click.Path(path_type=Path), default=None, help="Folder of an interrupted run to go on with."
)
@quiet_option
def discover(
    table: Path | None, mechanism: LoadedMechanism | None, minutes: float, holdout: float, noise: str | None,
    condition_limit: float | None, seed: int, workers: int | None, scheduler: str | None, out: Path | None,
    resume: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Find what the model of MECHANISM is missing on the poses of TABLE."""
    findings: list[Finding] = []
    rounds: list[Round] = []
    request: dict[str, Any] = {
        "table": None if table is None else str(table.resolve()),
        "choice": None if mechanism is None else dataclasses.asdict(mechanism.choice),
        "minutes": minutes, "holdout": holdout, "noise": noise, "condition_limit": condition_limit, "seed": seed,
    }  # fmt: skip
    if resume is not None:
        request, findings, rounds = checkpoint.load(resume)
        out = out or resume
    if request["table"] is None or request["choice"] is None:
        raise InputError("discover: expected a TABLE and --mechanism M, or --resume DIR")
    folder = out or Path("discovery")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; expected a folder", "folder")
    with progress(quiet) as say, cluster(scheduler) as mapper:
        discover_table(request, folder, say, workers, (findings, rounds), mapper)
    if not quiet:
        click.echo(f"report: {folder / 'report.html'}")


def discover_table(
    request: dict[str, Any], folder: Path, say: Callable[[str], None], workers: int | None = None,
    resume: tuple[Sequence[Finding], Sequence[Round]] = ((), ()), mapper: Mapper = map,
) -> Report:  # fmt: skip
    """Run what `request` asks and leave the results in `folder`; the report.

    request: table, choice (of the mechanism), minutes, holdout, noise, condition_limit, seed.
    """
    choice = MechanismChoice(**request["choice"])
    noise = None if request["noise"] is None else parse_quantity(request["noise"], "length", "--noise")
    mechanism, poses = sound_poses(choice.load(), Path(request["table"]))
    train, heldout = hold_out(poses.dataset, request["holdout"], np.random.default_rng(request["seed"]))
    runs = max(2, round(RUNS_A_MINUTE * request["minutes"]))
    search = Search(
        runs=runs, stop_after=600 * request["minutes"], workers=workers or os.cpu_count() or 1, mapper=mapper
    )  # fmt: skip
    found = run_loop(
        mechanism, poses, train, heldout, search=search, condition_limit=request["condition_limit"],
        seed=request["seed"], progress=say,
        keep=lambda findings, rounds: checkpoint.save(folder, request, findings, rounds), resume=resume,
    )  # fmt: skip
    say("writing the report")
    return write_results(found, folder, request["seed"], noise)


def write_results(found: Discovery, folder: Path, seed: int, noise: float | None) -> Report:
    """report.html, report.json, model.json, figures and, for robots, calibrated.urdf: all of them or none."""
    report = from_discovery(found, Origin(command_line(), seed, found.seconds, noise))
    with finished_folder(folder) as draft:
        write_text(draft / "report.json", to_json(report))
        save_model(draft / "model.json", saved_model(found.final, found.poses.dataset))
        write_urdf(found, draft / "calibrated.urdf")
        write_page(report, draft, write_figures(report, draft))
    (folder / checkpoint.NAME).unlink(missing_ok=True)
    return report


def write_urdf(found: Discovery, path: Path) -> None:
    """The geometric part as URDF, where the mechanism knows how to write itself."""
    export = getattr(getattr(found.mechanism, "bare", found.mechanism), "write_urdf", None)
    if export is None:
        return
    twists: dict[str, Any] = {}
    for effect, value in zip(found.final.model.effects, found.final.theta, strict=True):
        if effect.constant and value != 0.0:
            for slot in effect.slots:
                one = value * effect.twist(found.poses.states.subset(np.arange(1)), slot)[0]
                twists[slot] = twists.get(slot, np.zeros(6)) + one
    export(path, twists)


@contextlib.contextmanager
def cluster(address: str | None) -> Iterator[Mapper]:
    """Where GP runs go: here, or to a dask scheduler. Raises InputError when dask or the scheduler is not there."""
    if address is None:
        yield map
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler: needs dask; pip install 'gpmodel[cluster]'") from None
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {address}: no dask scheduler answers there ({error})") from None
    with client:
        yield client.get_executor().map


@contextlib.contextmanager
def progress(quiet: bool) -> Iterator[Callable[[str], None]]:
    """A line that says what is being tried and for how long; on a terminal it stays in place."""
    if quiet:
        yield lambda text: None
        return
    from rich.console import Console

    console = Console(stderr=True)
    started = time.monotonic()
    with console.status("starting") as status:

        def say(text: str) -> None:
            line = f"{time.monotonic() - started:5.0f} s  {text}"
            if console.is_terminal and "done" in text:
                status.update(line)
            else:
                console.print(line, highlight=False, markup=False)

        yield say
