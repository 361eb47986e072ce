"""`gpmodel joint`: the spherical joint's engineering models from the command line."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gpmodel.cli.terminal import echo
from gpmodel.extras import extra_for

if TYPE_CHECKING:
    from rich.table import Table as RichTable

    from joints.studies.study import Study, Table

PATH = click.Path(path_type=Path)
_HELP = {
    "design": "One page for a joint: every limit, and the one that governs.",
    "preload": "Magnetic preload, its limits over the joint angle, and the choice of socket, ring and magnet.",
    "contact": "Hertz contact of the ball on a support: deformation, stress against yield, stiffness.",
    "thermal": "Thermal growth of the socket, the measuring loop and the gap.",
    "film": "Design guide of the air film: gap, flow, pressures and stiffness, flat plate and sphere.",
    "stiffness": "Force-displacement curve and the regimes of a measured one.",
    "dynamics": "Frequency response of the joint on its air film.",
    "pugh": "Pugh charts: concepts scored against a baseline.",
    "budget": "Error budget: distribution of the position error and the share of every parameter.",
    "contact_types": "Point, rolling, sliding and fluid contact: published residuals compared.",
}


@click.group()
def joint() -> None:
    """Engineering models of a precision joint.

    Without a TOML table: of the thesis' spherical joint.
    """


def _command(name: str) -> click.Command:
    @click.command(name, help=_HELP[name])
    @click.argument("toml", required=False, type=PATH)
    @click.option("--json", "json_file", type=PATH, help="Write every number to FILE.", metavar="FILE")
    @click.option("--out", type=PATH, metavar="DIR", help="Write joint_<name>.json and figures/*.png to DIR.")
    @click.option(
        "--seed", default=0, show_default=True, type=click.IntRange(0), help="Seed of simulated measurements."
    )
    @click.option("--defaults", is_flag=True, help="Print the TOML table of the thesis' joint and stop.")
    def run(toml: Path | None, json_file: Path | None, out: Path | None, seed: int, defaults: bool) -> None:
        from gpmodel.files import finished_folder, write_bytes
        from joints.settings import DATA

        with extra_for("gpmodel joint"):
            import rich  # noqa: F401

            from joints.studies import STUDIES

        if defaults:
            echo((DATA / f"{name}.toml").read_text(encoding="utf-8"), nl=False)
            return
        study = STUDIES[name](toml, seed)
        files = study_files(name, study, seed, json_file, out)
        with finished_folder(out) if out else nullcontext(Path()) as draft:
            for path, content in files.items():
                write_bytes(draft / path.relative_to(out) if out and path.is_relative_to(out) else path, content)
        show(study, [str(path) for path in files])

    return run


for _name in _HELP:
    joint.add_command(_command(_name))


@joint.command("mechanism", help="The joint of a TOML file as --mechanism takes it: what it is, or why it is none.")
@click.argument("toml", required=False, type=PATH)
@click.option("--defaults", is_flag=True, help="Print the TOML file of the built-in joint and stop.")
def _mechanism(toml: Path | None, defaults: bool) -> None:
    from joints.description import read_joint, spherical_joint
    from joints.settings import DATA

    if defaults:
        echo((DATA / "spherical_joint.toml").read_text(encoding="utf-8"), nl=False)
        return
    found = read_joint(toml) if toml else spherical_joint()
    lever = ", ".join(f"{1e3 * v:g}" for v in found.tooling_ball)
    echo(f"{found.name}: tooling ball at ({lever}) mm in the frame after {found.rotations[-1].name}")
    for r in found.rotations:
        said = "measured" if r.measured else "approximate, solved at every pose"
        echo(f"  {r.name} about {r.axis}, {math.degrees(r.lower):g} to {math.degrees(r.upper):g} deg, {said}")


def study_files(name: str, study: Study, seed: int, json_file: Path | None, out: Path | None) -> dict[Path, bytes]:
    """Every file a command writes, complete in memory: the numbers as JSON and the figures as PNG."""
    from gpmodel.files import plain
    from joints.studies.study import png

    record = plain({"schema": 1, "command": f"joint {name}", "seed": seed, **study.data})
    numbers = (json.dumps(record, indent=1) + "\n").encode()
    files: dict[Path, bytes] = {}
    if out is not None:
        files[out / f"joint_{name}.json"] = numbers
        for figure_name, figure in study.figures.items():
            files[out / "figures" / figure_name] = png(figure)
        files |= {out / page_name: text.encode() for page_name, text in study.pages.items()}
    if json_file is not None:
        files[json_file] = numbers
    return files


def show(study: Study, files: list[str]) -> None:
    """Print the tables, in blocks of columns that fit the terminal, and the names of the written files."""
    from rich.console import Console

    console = Console(highlight=False, markup=False, emoji=False)
    with console.capture() as drawn:
        for table in study.tables:
            for block in fitting(table, console.width):
                console.print(_rich(block, console.width))
    echo(click.unstyle(drawn.get()) + "".join(f"{file}\n" for file in files), nl=False)


def fitting(table: Table, width: int) -> list[Table]:
    """The table in blocks of whole columns within `width` characters, each led by the first column."""
    needed = [least for least, _ in map(_widths, _columns(table))]
    blocks: list[list[int]] = [[0]]
    for i in range(1, len(needed)):
        if 1 + sum(needed[k] + 3 for k in (*blocks[-1], i)) > width and len(blocks[-1]) > 1:
            blocks.append([0])
        blocks[-1].append(i)
    return [
        replace(
            table,
            title=table.title if n == 0 else f"{table.title}, continued",
            columns=[table.columns[i] for i in block],
            rows=[[row[i] for i in block] for row in table.rows],
            note=table.note if n == len(blocks) - 1 else "",
        )
        for n, block in enumerate(blocks)
    ]


def _columns(table: Table) -> list[list[object]]:
    """Every column with its head first."""
    return [[head, *(row[i] for row in table.rows)] for i, head in enumerate(table.columns)]


def _widths(column: Sequence[object]) -> tuple[int, int]:
    """Characters a column needs at least, numbers whole and text broken between words, and those it would like."""
    parts = [part for cell in column for part in (cell.split() if isinstance(cell, str) else [_cell(cell)])]
    return max(map(len, parts), default=1), max(len(_cell(cell)) for cell in column)


def _rich(table: Table, width: int) -> RichTable:
    from rich.table import Table as RichTable

    rich = RichTable(title=table.title, caption=table.note or None, title_justify="left", caption_justify="left")
    widths = [_widths(column) for column in _columns(table)]
    spare = width - 1 - sum(least + 3 for least, _ in widths)
    for head, (least, liked) in zip(table.columns, widths, strict=True):
        more = max(0, min(liked - least, spare))
        spare -= more
        rich.add_column(head, width=least + more)
    for row in table.rows:
        rich.add_row(*map(_cell, row))
    return rich


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
