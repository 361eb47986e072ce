"""`gpmodel joint`: engineering models of the spherical joint on the command line."""

from __future__ import annotations

import json
import math
import shutil
import textwrap
from collections.abc import Iterator
from contextlib import nullcontext
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gpmodel.cli.terminal import echo
from gpmodel.extras import extra_for

if TYPE_CHECKING:
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

    Without a TOML table the models describe the spherical joint of the thesis.
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
    from joints.passive_joint import read_joint, spherical_joint
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
    """Return {path: content} of the files that a command writes: numbers as JSON, figures as PNG, pages."""
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
    """Print the tables of a study, in blocks of columns that fit the terminal, and the names of the written files."""
    width = shutil.get_terminal_size().columns
    lines = [line for table in study.tables for line in lines_of(table, width)]
    echo("".join(f"{line}\n" for line in (*lines, *files)), nl=False)


def lines_of(table: Table, width: int) -> Iterator[str]:
    """Yield the lines of a table in blocks of whole columns within `width` characters. Every block of columns starts
    with the table's first column. Texts break between words; numbers do not break."""
    columns = [[head, *(_cell(row[k]) for row in table.rows)] for k, head in enumerate(table.columns)]
    least = [max(len(word) for cell in column for word in (cell.split() or [""])) for column in columns]
    blocks: list[list[int]] = [[0]]
    for k in range(1, len(columns)):
        if sum(least[i] + 2 for i in (*blocks[-1], k)) - 2 > width and len(blocks[-1]) > 1:
            blocks.append([0])
        blocks[-1].append(k)
    for number, block in enumerate(blocks):
        spare, wide = width + 2 - sum(least[k] + 2 for k in block), dict[int, int]()
        for k in block:
            wide[k] = least[k] + max(0, min(max(map(len, columns[k])) - least[k], spare))
            spare -= wide[k] - least[k]
        yield from textwrap.wrap(table.title if number == 0 else f"{table.title}, continued", width)
        for row in range(len(table.rows) + 1):
            parts = [textwrap.wrap(columns[k][row], wide[k], break_on_hyphens=False) for k in block]
            for line in zip_longest(*parts, fillvalue=""):
                yield "  ".join(f"{text:<{wide[k]}}" for k, text in zip(block, line, strict=True)).rstrip()
            if row == 0:
                yield "  ".join("─" * wide[k] for k in block)
    yield from (*textwrap.wrap(table.note, width), "")


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
