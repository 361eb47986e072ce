"""`gpmodel evolve`: compensators or slot shapes by many runs, and the histogram of the inputs they refer to."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from gpmodel._version import __version__
from gpmodel.api.table import read_table
from gpmodel.calibration.gauss_newton import calibrate
from gpmodel.calibration.payload import hang_payload
from gpmodel.checks.judge import refuse
from gpmodel.cli.console import command_line, console_for_text
from gpmodel.cli.options import mechanism_options, out_folder_option, quiet_option, seed_option, table_argument
from gpmodel.errors import InputError
from gpmodel.evolution.input_histogram import Histogram, histogram
from gpmodel.evolution.linear import Linear
from gpmodel.evolution.problems import Problem
from gpmodel.evolution.runs import Run, load_runs, run_all, save_runs
from gpmodel.evolution.settings import Budget, Settings, thesis_settings
from gpmodel.evolution.tree import Tree
from gpmodel.files import finished_folder, to_json
from gpmodel.mechanism.source import LoadedMechanism
from gpmodel.model.error_model import ErrorModel, prepare
from gpmodel.model.geometric import standard_effects
from gpmodel.table.split import hold_out

REPRESENTATIONS: dict[str, type[Linear | Tree]] = {"linear": Linear, "tree": Tree}
POPULATIONS = {"cartesian": {"linear": 65536, "tree": 4096}, "slot": {"linear": 1024, "tree": 512}}


def settings_for(
    space: str, names: Sequence[str], operators: str | None, population: int | None, budget: dict[str, Any]
) -> dict[str, Settings]:
    """The thesis' settings in Cartesian space and the defaults at a slot, with what was asked changed.

    budget: fields of ``Budget`` that were asked for. Raises InputError for an unknown representation or operator,
    or a population too small to select from.
    """
    chosen = {}
    for name in names:
        if name not in REPRESENTATIONS:
            raise InputError(f"--representation {name!r}: expected {' or '.join(REPRESENTATIONS)}")
        kind = REPRESENTATIONS[name]
        representation = kind.thesis() if space == "cartesian" else kind()
        if operators is not None:
            representation = replace(representation, operators=operators)
        size = population or POPULATIONS[space][name]
        settings = thesis_settings(representation, size)
        if space == "slot":
            settings = Settings(representation, budget=Budget(size, generations=100, seconds=1e9))
        if "seconds" in budget and "generations" not in budget:
            settings = settings.with_budget(generations=1_000_000)
        chosen[name] = settings.with_budget(**budget)
    return chosen


@click.command()
@table_argument
@mechanism_options()
@click.option("--representation", default="linear,tree", show_default=True, help="linear, tree, or both.")
@click.option("--space", type=click.Choice(["cartesian", "slot"]), default="cartesian", show_default=True,
              help="Compensate the tip, or find the shape and the place of an effect.")  # fmt: skip
@click.option("--population", type=click.IntRange(4), default=None, help="[default: 65536 linear, 4096 tree]")
@click.option("--generations", type=click.IntRange(0), default=None, help="[default: 100]")
@click.option("--seconds", type=click.FloatRange(0, min_open=True), default=None, help="Time a run, at most.")
@click.option("--runs", type=click.IntRange(1), default=5, show_default=True, help="Of each representation.")
@click.option("--operators", default=None, help="thesis, smooth, slot, physics, or names.")
@click.option("--norm", type=click.Choice(["max", "rms"]), default="max", show_default=True)
@click.option("--standard", multiple=True, default=("*",), metavar="PATTERN", help="Parameters fitted first.")
@click.option("--holdout", default=0.3, show_default=True, type=click.FloatRange(0, 1, max_open=True))
@click.option("--workers", "threads", type=click.IntRange(0), default=0,
              help="Threads; the numbers do not depend on it. [default: all cores]")  # fmt: skip
@click.option("--checkpoint", type=click.Path(path_type=Path, dir_okay=False), default=None,
              help="File that keeps finished runs; given again, the rest is done.")  # fmt: skip
@seed_option
@out_folder_option
@quiet_option
def evolve(
    table: Path, mechanism: LoadedMechanism, representation: str, space: str, population: int | None,
    generations: int | None, seconds: float | None, runs: int, operators: str | None, norm: str,
    standard: tuple[str, ...], holdout: float, threads: int, checkpoint: Path | None, seed: int,
    folder: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Evolve programs on what the standard model leaves of TABLE; count the inputs they refer to.

    Every run is done again on shuffled errors: an input counts only where it stands out of those.
    With --out: evolve.json and programs.txt.
    """
    from gpmodel.discovery.problems import cartesian_task, slot_task

    names = [name.strip() for name in representation.split(",")]
    asked = {"generations": generations, "seconds": seconds, "threads": threads}
    budget = {name: value for name, value in asked.items() if value is not None}
    settings = settings_for(space, names, operators, population, budget)
    dataset = read_table(table, mechanism)
    arm, poses = hang_payload(mechanism, prepare(mechanism, dataset))
    geometry = standard_effects(arm, standard)
    refuse(arm, poses, geometry)
    held = np.zeros(0, dtype=np.int64)
    train = np.arange(len(dataset))
    if holdout > 0:
        train, held = hold_out(dataset, holdout, np.random.default_rng(seed))
    seen = poses.subset(train)
    fit = calibrate(ErrorModel(arm, geometry), seen, seed=seed)
    task = cartesian_task(fit, poses, train, held, norm) if space == "cartesian" else slot_task(fit, arm, seen, seed)
    request = {
        "sha256": dataset.sha256, "mechanism": mechanism.choice.name, "space": space, "norm": norm, "seed": seed,
        "holdout": holdout, "standard": list(standard),
        "settings": [repr(s.with_budget(threads=0)) for s in settings.values()],
    }  # fmt: skip
    finished = load_runs(checkpoint, request) if checkpoint else []
    done: list[Run] = []
    console = console_for_text()
    with Live(console=console, auto_refresh=False, transient=True) as live:
        shown = None if quiet or not console.is_terminal else live
        for run in run_all(task.problem, settings, runs, seed, task.heldout, finished, _progress(shown, runs)):
            done.append(run)
            if checkpoint:
                save_runs(checkpoint, request, done)
    counted = histogram([run.record() for run in done], task.problem.inputs.names)
    if not quiet:
        show(console, done, counted)
    if folder is not None:
        with finished_folder(folder) as draft:
            report = report_of(done, counted, task.problem, request)
            (draft / "evolve.json").write_text(to_json(report), encoding="utf-8")
            (draft / "programs.txt").write_text(_programs(done), encoding="utf-8")
        if not quiet:
            click.echo(f"evolve.json and programs.txt are in {folder}")


def report_of(runs: Sequence[Run], counted: Histogram, problem: Problem, request: dict[str, Any]) -> dict[str, Any]:
    """The content of evolve.json."""
    return {
        "schema": 1,
        "command": command_line(),
        "versions": {"gpmodel": __version__, "numpy": np.__version__},
        "request": request,
        "sites": list(problem.sites),
        "histogram": {
            "inputs": list(counted.inputs),
            "runs": counted.runs,
            "counts": {kind: values.tolist() for kind, values in counted.counts.items()},
            "shuffled_runs": counted.shuffled_runs,
            "shuffled": {kind: values.tolist() for kind, values in counted.shuffled.items()},
            "operators": counted.operators,
            "p_values": counted.p_values.tolist(),
            "significant": list(counted.significant),
        },
        "runs": [run.__dict__ for run in runs],
    }


def show(console: Console, runs: Sequence[Run], counted: Histogram) -> None:
    """Print the runs on the residual, and the histogram beside that of the shuffled ones."""
    table = Table(box=None, pad_edge=False, padding=(0, 1))
    for heading in ("", "run", "gain", "held out", "nodes", "site"):
        table.add_column(heading, justify="right" if heading in ("run", "gain", "held out", "nodes") else "left")
    for run in runs:
        if not run.shuffled:
            heldout = "-" if run.heldout is None else f"{run.heldout:.3f}"
            table.add_row(
                run.representation, str(run.number + 1), f"{run.gain:.3f}", heldout, str(run.complexity), run.site
            )
    console.print("Best program of each run")
    console.print(table)
    chart = Table(box=None, pad_edge=False)
    chart.add_column("")
    for kind in counted.counts:
        chart.add_column(f"{kind}, {counted.runs[kind]} runs", justify="right")
    chart.add_column("p, corrected", justify="right")
    for k, name in enumerate(counted.inputs):
        cells = [f"{counted.counts[kind][k]} ({counted.shuffled[kind][k]})" for kind in counted.counts]
        chart.add_row(name, *cells, f"{counted.p_values[k]:.2g}")
    console.print("\nRuns that refer to each input (on shuffled errors)")
    console.print(chart)
    found = ", ".join(counted.significant)
    console.print(f"stands out of chance: {found}" if found else "no input stands out of chance")


def _programs(runs: Sequence[Run]) -> str:
    lines = [f"{run.representation} {run.number + 1}: {run.program}" for run in runs if not run.shuffled]
    return "\n".join(lines) + "\n"


def _progress(live: Live | None, runs: int) -> Any:
    if live is None:
        return None

    def report(representation: str, number: int, shuffled: bool, state: Any) -> None:
        what = f"{representation} {number + 1}/{runs}{' shuffled' if shuffled else ''}"
        live.update(
            Text(
                f"{what}: generation {state.generation}, best {state.best:.4g}, median {state.median:.4g}, "
                f"gain {state.gain:.3f}, {state.distinct} distinct, "
                f"{state.evaluations_per_second:,.0f} programs/s, {state.seconds_left:.0f} s left"
            ),
            refresh=True,
        )

    return report
