"""Options every command shares, and what they load."""

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import click

from gpmodel.errors import InputError
from gpmodel.mechanism.source import MechanismChoice
from gpmodel.table.units import parse_quantity

Command = TypeVar("Command", bound=Callable[..., Any])

seed_option = click.option("--seed", default=0, show_default=True, help="Seed of everything random.")
quiet_option = click.option("--quiet", is_flag=True, help="Print nothing but errors.")
workers_option = click.option(
    "--workers",
    type=click.IntRange(1),
    default=None,
    help="Threads; the numbers do not depend on it. [default: all cores]",
)
out_folder_option = click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=None,
    help="Folder for the results; nothing is written without it.",
)
out_file_option = click.option(
    "--out", type=click.Path(path_type=Path), default=None, help="A .csv file, or a folder for it. [default: print it]"
)
table_argument = click.argument("table", type=click.Path(path_type=Path))


def mechanism_options(command: Command) -> Command:
    """Adds --mechanism, --frame, --payload, --payload-com; the command receives them as `choice`."""

    @wraps(command)
    def wrapped(
        *args: Any, mechanism: str, frame: str | None, payload: str | None, payload_com: str | None, **rest: Any
    ) -> Any:
        mass = None if payload is None else parse_quantity(payload, "mass", "--payload")
        com = None if payload_com is None else _lengths(payload_com, "--payload-com")
        return command(*args, choice=MechanismChoice(mechanism, frame, mass, com), **rest)

    options = (
        click.option("--mechanism", required=True, metavar="NAME", help="Built-in name, .urdf, or .toml of DH rows."),
        click.option("--frame", default=None, help="Measured link of the mechanism. [default: the last one]"),
        click.option("--payload", default=None, metavar="MASS", help="Mass at the tool in every row, as in 60kg."),
        click.option("--payload-com", default=None, metavar="X,Y,Z", help="Its centre in the measured link: 0,0,90mm."),
    )
    for option in reversed(options):
        wrapped = option(wrapped)
    return wrapped  # type: ignore[return-value]


def _lengths(text: str, where: str) -> tuple[float, ...]:
    parts = [p.strip() for p in text.split(",")]
    unit = parts[-1].lstrip("+-.0123456789eE").strip()
    if len(parts) != 3:
        raise InputError(f"{where} '{text}': expected three lengths with a unit, as in 0,0,120mm")
    numbers = [p if p.endswith(unit) else f"{p}{unit}" for p in parts] if unit else parts
    return tuple(parse_quantity(n, "length", where) for n in numbers)
