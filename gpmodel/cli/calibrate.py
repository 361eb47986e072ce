"""`gpmodel calibrate`: registration, the standard model and the effects named, before and after."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from gpmodel._version import __version__
from gpmodel.application.model_file import model_text, saved_model
from gpmodel.calibration.comparison import Rung, climb
from gpmodel.calibration.gauss_newton import Calibration
from gpmodel.calibration.gauss_newton import calibrate as fit_model
from gpmodel.calibration.payload import hang_payload
from gpmodel.checks.judge import refuse
from gpmodel.cli.console import command_line, console_for_text
from gpmodel.cli.options import (
    mechanism_options,
    out_folder_option,
    quiet_option,
    seed_option,
    table_argument,
    workers_option,
)
from gpmodel.errors import InputError
from gpmodel.families.by_name import effects_named
from gpmodel.files import finished_folder, to_json
from gpmodel.mechanism.protocol import Mechanism
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.model.effect import Effect
from gpmodel.model.error_model import prepare
from gpmodel.model.geometric import standard_effects
from gpmodel.table.bundles import noise_floor
from gpmodel.table.dataset import Dataset
from gpmodel.table.read import read_table
from gpmodel.table.split import hold_out


def split(dataset: Dataset, holdout: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Training rows and held-out rows; none are held out with a share of 0."""
    if holdout == 0.0:
        return np.arange(len(dataset)), np.zeros(0, dtype=np.int64)
    return hold_out(dataset, holdout, np.random.default_rng(seed))


@click.command()
@table_argument
@mechanism_options
@click.option("--effect", "names", multiple=True, metavar="NAME", help="'gear_harmonic J4', or 'J4.moving:Rz:sin(J4)'.")
@click.option("--standard", multiple=True, default=("*",), metavar="PATTERN", help="Parameters held: 'J* R?', none.")
@click.option("--condition-limit", type=click.FloatRange(min=1), help="[default: chosen by cross-validation]")
@click.option("--holdout", default=0.3, show_default=True, type=click.FloatRange(0, 1, max_open=True))
@seed_option
@workers_option
@out_folder_option
@quiet_option
def calibrate(
    table: Path,
    choice: MechanismChoice,
    names: tuple[str, ...],
    standard: tuple[str, ...],
    condition_limit: float | None,
    holdout: float,
    seed: int,
    workers: int | None,
    out: Path | None,
    quiet: bool,
) -> None:
    """Fit registration, tool, the standard model and the named effects to TABLE; say what it gained.

    Errors are of poses held out of the fit; the saved model is fitted to all poses.
    With --out: model.json, report.json.
    """
    started = time.perf_counter()
    mechanism = choice.load()
    dataset = read_table(table, mechanism, choice.payload)
    choice, mechanism, poses = hang_payload(choice, mechanism, prepare(mechanism, dataset))
    geometry = standard_effects(mechanism, standard)
    groups = [(name, effects_named(name, mechanism, poses.states)) for name in names]
    refuse(mechanism, poses, geometry)
    train, held = split(dataset, holdout, seed)
    rungs = climb(mechanism, poses, train, held, geometry, groups, condition_limit=condition_limit, seed=seed)
    fit = fit_model(rungs[-1].fit.model, poses, condition_limit=condition_limit, seed=seed)
    for step, tried in [*((r.step, r.fit) for r in rungs), ("all poses", fit)]:
        if tried.status == "diverged":
            raise InputError(f"{dataset.source}: the fit of {step} diverged: {tried.reason}")
    seconds = time.perf_counter() - started
    report = report_of(mechanism, dataset, rungs, fit, groups, seed, seconds)
    if not quiet:
        show(console_for_text(), rungs, fit, dataset)
    if out is not None:
        with finished_folder(out) as folder:
            (folder / "model.json").write_text(model_text(saved_model(choice, fit, dataset)), encoding="utf-8")
            (folder / "report.json").write_text(to_json(report), encoding="utf-8")
        if not quiet:
            click.echo(f"model.json and report.json are in {out}")


def report_of(
    mechanism: Mechanism,
    dataset: Dataset,
    rungs: Sequence[Rung],
    fit: Calibration,
    groups: Sequence[tuple[str, tuple[Effect, ...]]],
    seed: int,
    seconds: float,
) -> dict[str, Any]:
    """The content of report.json."""
    ladder = []
    for rung in rungs:
        entry: dict[str, Any] = {"step": rung.step, "train": rung.train.as_mm(), "heldout": rung.heldout.as_mm()}
        ladder.append(entry | {"rank": rung.fit.rank, "dropped": list(rung.fit.dropped)})
    last = rungs[-1]
    named = {e.name for _, group in groups for e in group}
    floor = noise_floor(dataset)
    return {
        "schema": 1,
        "command": command_line(),
        "versions": {"gpmodel": __version__, "numpy": np.__version__},
        "seed": seed,
        "data": {
            "file": dataset.source,
            "sha256": dataset.sha256,
            "poses": len(dataset),
            "train": len(last.fit.error),
            "heldout": len(dataset) - len(last.fit.error),
            "outliers": dataset.row[fit.outliers],
        },
        "mechanism": {"name": mechanism.name, "joints": [j.name for j in mechanism.joints]},
        "ladder": ladder,
        "parameters": [p for p in parameters_of(fit) if p["name"] not in named],
        "effects": [p for p in parameters_of(fit) if p["name"] in named],
        "condition_limit": fit.condition_limit,
        "rank_curve": [
            {"condition_limit": c.condition_limit, "rank": c.rank, "cv_rms_mm": 1e3 * c.cv_rms} for c in fit.rank_curve
        ],
        "status": fit.status,
        "reason": fit.reason,
        "sigma_mm": 1e3 * fit.sigma,
        "noise_floor_mm": None if floor is None else 1e3 * floor,
        "verdict": verdict(rungs),
        "seconds": seconds,
    }


def parameters_of(fit: Calibration) -> list[dict[str, Any]]:
    """Each effect of a fit as report.json has it."""
    partners = fit.partners()
    return [
        {
            "name": effect.name,
            "slot": ", ".join(effect.slots),
            "axis": ", ".join(dict.fromkeys(t.axis for t in effect.terms)),
            "basis": "; ".join(dict.fromkeys(str(t.basis) for t in effect.terms)),
            "inputs": list(effect.inputs),
            "value": value,
            "stderr": stderr,
            "unit": effect.unit,
            "kept": bool(kept),
            "unique_share": share,
            "found_by": "named",
            "catalogue": effect.family,
            "partners": [{"name": n, "correlation": c} for n, c in partners.get(effect.name, ())],
        }
        for effect, value, stderr, kept, share in zip(
            fit.model.effects, fit.theta, fit.stderr, fit.kept, fit.unique_share, strict=True
        )
    ]


def verdict(rungs: Sequence[Rung]) -> str:
    """One sentence: from registration to the last step."""
    held = np.isfinite(rungs[0].heldout.rms)
    first, last = ((r.heldout if held else r.train).rms * 1e3 for r in (rungs[0], rungs[-1]))
    where = "poses held out" if held else "the poses fitted to"
    return f"error on {where}: {first:.4f} mm RMS with registration alone, {last:.4f} mm with {rungs[-1].step}"


def show(console: Console, rungs: Sequence[Rung], fit: Calibration, dataset: Dataset) -> None:
    """Print the ladder, the parameters and what to distrust."""
    steps = Table(title="3-D error, mm", title_justify="left", box=None, pad_edge=False, padding=(0, 1))
    steps.add_column("", no_wrap=True)
    for side in ("train", "held out"):
        for statistic in ("mean", "rms", "max"):
            steps.add_column(f"{side}\n{statistic}", justify="right")
    steps.add_column("unknowns", justify="right")
    for r in rungs:
        values = [x for e in (r.train, r.heldout) for x in (e.mean, e.rms, e.max)]
        steps.add_row(r.step, *("-" if np.isnan(v) else f"{1e3 * v:.4f}" for v in values), str(r.fit.rank))
    console.print(steps)
    if fit.model.effects:
        console.print(_parameter_table(fit))
    if fit.dropped:
        console.print(f"not identifiable with these poses, held at zero: {', '.join(fit.dropped)}", soft_wrap=True)
    if len(fit.outliers):
        console.print(f"outliers, not fitted: rows {', '.join(map(str, dataset.row[fit.outliers]))}", soft_wrap=True)
    if len(rungs[0].fit.error) < len(dataset) and np.isnan(rungs[-1].heldout.rms):
        console.print("held out are only poses of set-ups or tools not trained on: no error can be given for them")
    console.print(f"{fit.status}: {fit.reason}; condition limit {fit.condition_limit:g}", soft_wrap=True)
    console.print(verdict(rungs), soft_wrap=True)


def _parameter_table(fit: Calibration) -> Table:
    table = Table(
        title="\nParameters, fitted to all poses", title_justify="left", box=None, padding=(0, 2), pad_edge=False
    )
    for heading in ("", "value", "± sigma", "unit", "unique share", "correlated with"):
        table.add_column(
            heading, justify="left" if heading in ("", "unit", "correlated with") else "right", no_wrap=True
        )
    for p in parameters_of(fit):
        if p["kept"]:
            scale, unit = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}.get(p["unit"], (1.0, p["unit"]))
            near = ", ".join(f"{x['name']} {x['correlation']:+.2f}" for x in p["partners"])
            value, sigma = f"{scale * p['value']:.4g}", f"{scale * p['stderr']:.2g}"
            table.add_row(p["name"], value, sigma, unit, f"{p['unique_share']:.2f}", near)
    return table
