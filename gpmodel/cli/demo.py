"""Command `gpmodel demo`: find an undeclared effect in an example table, and open the report."""

import os
import sys
from importlib import resources
from pathlib import Path

import click

from gpmodel.api.arguments import load_mechanism
from gpmodel.api.discover import discover
from gpmodel.api.simulate import SimulationResult, simulate
from gpmodel.characters import shell_quoted
from gpmodel.checks.notes import unknowns
from gpmodel.cli.console import command_line, place_for, progress_line, what_next
from gpmodel.cli.discover import write_results
from gpmodel.cli.options import PATH, quiet_option, seed_option, workers_option
from gpmodel.cli.terminal import echo
from gpmodel.discovery.search import Search
from gpmodel.executor import Forks
from gpmodel.files import folder_for, write_text
from gpmodel.model.sites import geometric_effects
from gpmodel.table.cells import table_text

TABLE = "demo.csv"
MECHANISM = "irb6400r"
VALUES, TEN = 6, 10
"""Measurements per unknown of the standard model, and the multiple to which the number of poses is rounded up. With
half as many measurements, an effect of 40 arcsec is often not confirmed; twice as many halve its variance."""
EFFECT = "joint_compliance J2=2e-7 rad/Nm"
"""Undeclared effect in the example files: about 0.1 mm at the tool, three times the noise."""
REPEATED = 5
"""Number of example poses measured three times. With 30 degrees of freedom the noise is known to within a seventh."""


@click.command()
@click.option("--out", "folder", type=PATH, default=Path("demo-report"), show_default=True)
@click.option("--mine", metavar="MECH", help="Mechanism to simulate and calibrate, instead of the shipped table.")
@click.option("--files", is_flag=True, help="Write example files for all commands (an arm, tables, targets) instead.")
@click.option("--no-open", is_flag=True, help="Do not open the report in a browser.")
@seed_option
@workers_option
@quiet_option
def demo(
    folder: Path, mine: str | None, files: bool, no_open: bool, seed: int, workers: int | None, quiet: bool
) -> None:
    """Find an undeclared effect of an IRB 6400R in 90 shipped poses, and write the report.

    --mine MECH simulates the table that you would measure on your mechanism MECH, with constant errors of 0.3 mm,
    a gear error of 40 arcsec and noise of 0.03 mm, and states how many poses of which kind to measure.
    """
    if files:
        written = example_files(folder, seed)
        if not quiet:
            echo(f"{', '.join(written)} in {folder}: simulated, {EFFECT} undeclared")
        return
    folder_for(folder)
    with resources.as_file(resources.files("gpmodel") / "data" / TABLE) as shipped, progress_line(quiet) as say:
        table = shipped
        if mine:
            table = place_for(folder / "table.csv", "") or shipped
            made = like_mine(mine, seed)
            made.save(table, command=command_line(), seed=seed)
        search = Search(runs=0 if mine else Search().runs, executor=Forks(workers or 0))
        found = discover(mine or MECHANISM, table, seed=seed, search=search, progress=say, command=command_line())
        write_results(found, folder, say, workers or 0)
    if not quiet:
        echo(found.summary())
        if mine:
            echo(to_measure(made, mine, table))
        echo(what_next(folder, found.record))
        shown = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        if not no_open and shown and not os.environ.get("CI"):
            click.launch(str(folder / "report.html"))


def example_files(folder: Path, seed: int) -> list[str]:
    """Write example files for the commands: an arm, a measured table, poses, targets, and a table measured later.

    Raises InputError if a file cannot be written.
    """
    arm = (resources.files("gpmodel") / "data" / "arm.urdf").read_text(encoding="utf-8")
    write_text(folder_for(folder) / "arm.urdf", arm)
    made = simulate(folder / "arm.urdf", [EFFECT], poses=120, geometry_sigma="0.3 mm", seed=seed).to_dataframe()
    joints = [name for name in made if str(name)[0] not in "xyz"]
    tables = {
        "table.csv": made.iloc[:80], "measured-again.csv": made.iloc[80:100],
        "poses.csv": made.iloc[100:][joints], "targets.csv": made.iloc[100:][joints],
    }  # fmt: skip
    for name, frame in tables.items():
        write_text(folder / name, table_text(frame))
    return ["arm.urdf", *tables]


def like_mine(name: str, seed: int) -> SimulationResult:
    """Simulate a table for a mechanism, with the poses that its standard model needs and a gear error of revolute joint
    2.

    Raises InputError for an unreadable mechanism.
    """
    mechanism = load_mechanism(name)
    turning = [joint.name for joint in mechanism.joints if joint.kind == "revolute"][:2]
    effects = [f"gear_harmonic {joint}=40 arcsec" for joint in turning[-1:]]
    few = simulate(mechanism, poses=1, seed=seed).table
    needed = VALUES * unknowns(mechanism, few, geometric_effects(mechanism)) / 3
    poses = TEN * int(-(-needed // TEN))
    return simulate(mechanism, effects, poses=poses, geometry_sigma="0.3 mm", seed=seed)


def to_measure(made: SimulationResult, name: str, table: Path) -> str:
    """State the simulated errors, and how many poses of which kind to measure on the real machine."""
    count, mechanism = len(made.table), shell_quoted(name)
    planted = ", ".join(e.name for e in made.truth.saved.model.effects if not e.constant) or "constant errors alone"
    return (
        f"simulated: {table}, planted: {planted}\n"
        f"to measure: {count} poses spread over all joints, {REPEATED} of them three times (column repeat)\n"
        f"  gpmodel poses --mechanism {mechanism} -n {count} --out poses.csv"
    )
