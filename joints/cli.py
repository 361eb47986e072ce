"""`gpmodel joint`: the spherical joint's engineering models from the command line."""

import io
import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table as RichTable

from gpmodel.errors import InputError
from joints.studies.study import Study, Table, plain

_HELP = {
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
    """Engineering models of a precision spherical joint; without a TOML table, the thesis' joint."""


def _command(name: str) -> click.Command:
    @click.command(name, help=_HELP[name])
    @click.argument("toml", required=False, type=click.Path(path_type=Path))
    @click.option(
        "--json", "json_file", type=click.Path(path_type=Path), help="Write every number to FILE.", metavar="FILE"
    )
    @click.option(
        "--out",
        type=click.Path(path_type=Path),
        metavar="DIR",
        help="Write joint_<name>.json and figures/*.png to DIR.",
    )
    @click.option("--seed", default=0, show_default=True, help="Seed of simulated measurements.")
    @click.option("--defaults", is_flag=True, help="Print the TOML table of the thesis' joint and stop.")
    def run(toml: Path | None, json_file: Path | None, out: Path | None, seed: int, defaults: bool) -> None:
        from joints.settings import DATA
        from joints.studies import STUDIES

        if defaults:
            click.echo((DATA / f"{name}.toml").read_text(encoding="utf-8"), nl=False)
            return
        study = STUDIES[name](toml, seed)
        files = study_files(name, study, seed, json_file, out)
        write_all(files)
        show(study, [str(path) for path in files])

    return run


for _name in _HELP:
    joint.add_command(_command(_name))


def study_files(name: str, study: Study, seed: int, json_file: Path | None, out: Path | None) -> dict[Path, bytes]:
    """Every file a command writes, complete in memory: the numbers as JSON and the figures as PNG."""
    record = {"schema": 1, "command": f"joint {name}", "seed": seed, **plain(study.data)}
    text = (json.dumps(record, indent=1) + "\n").encode()
    files: dict[Path, bytes] = {}
    if json_file is not None:
        files[json_file] = text
    if out is not None:
        files[out / f"joint_{name}.json"] = text
        for figure_name, figure in study.figures.items():
            image = io.BytesIO()
            figure.savefig(image, format="png", dpi=110, metadata={"Software": None})
            files[out / "figures" / figure_name] = image.getvalue()
    return files


def write_all(files: Mapping[Path, bytes]) -> None:
    """Each file whole or not at all; InputError in one line where the disk refuses."""
    for path, content in files.items():
        temporary = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as handle:
                temporary = handle.name
                handle.write(content)
            os.chmod(temporary, 0o666 & ~_umask())
            os.replace(temporary, path)
        except OSError as error:
            if temporary is not None:
                Path(temporary).unlink(missing_ok=True)
            raise InputError(f"{path}: cannot be written ({error.strerror}), expected a writable place") from error


def show(study: Study, files: list[str]) -> None:
    """Print the tables and the names of the written files."""
    console = Console(width=None if Console().is_terminal else 150, highlight=False)
    for table in study.tables:
        console.print(_rich(table))
    for file in files:
        click.echo(file)


def _rich(table: Table) -> RichTable:
    rich = RichTable(title=table.title, caption=table.note or None, title_justify="left")
    for column in table.columns:
        rich.add_column(column.replace("[", r"\["), overflow="fold")
    for row in table.rows:
        rich.add_row(*(_cell(value) for value in row))
    return rich


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
