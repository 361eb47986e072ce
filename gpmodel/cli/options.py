"""Options that several commands of gpmodel share, and loading of the mechanism."""

import math
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TypeVar

import click

from gpmodel.api.arguments import load_mechanism
from gpmodel.characters import printable, steers
from gpmodel.errors import InputError


class Number(click.ParamType):
    """Type of an option that takes a finite number above a limit."""

    name = "number"

    def __init__(self, above: float) -> None:
        self.above = above

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Convert a text to a finite number above the limit; fail with a one-line message otherwise."""
        try:
            number = float(str(value))
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and number > self.above):
            self.fail(f"{value!r}, expected a finite number above {self.above:g}", param, ctx)
        return number


class NamedPath(click.Path):
    """Type of an option that takes a path: not empty, since this would mean the current folder, and printable."""

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> object:  # type: ignore[override]
        """Convert a text to a path; fail with a one-line message if the text is empty or has control characters."""
        if not str(value):
            self.fail("'' is no path", param, ctx)
        if steers(str(value)):
            self.fail(
                f"{printable(str(value), '')!r} holds control characters; expected a path without any", param, ctx
            )
        return super().convert(value, param, ctx)  # type: ignore[arg-type]


Command = TypeVar("Command", bound=Callable[..., object])

PATH = NamedPath(path_type=Path)
"""Type of an option that takes a file or folder, which need not exist."""
seed_option = click.option(
    "--seed", default=0, show_default=True, type=click.IntRange(0), help="Seed of all random numbers."
)
quiet_option = click.option("--quiet", is_flag=True, help="Print nothing but errors.")
workers_option = click.option(
    "--workers", type=click.IntRange(1), help="Number of processes; results do not depend on it. [default: all cores]"
)
scheduler_option = click.option(
    "--scheduler", metavar="ADDRESS",
    help="Executor: local:N processes, or dask at tcp://host:8786. [default: here]",
)  # fmt: skip
out_folder_option = click.option(
    "--out", "folder", type=PATH, help="Folder for the results; without a folder nothing is written."
)
page_option = click.option("--out", "folder", type=PATH, help="Folder for the HTML page.")
out_file_option = click.option("--out", type=PATH, help="A .csv file, or a folder for it. [default: print it]")
standard_option = click.option(
    "--standard",
    multiple=True,
    default=("*",),
    metavar="PATTERN",
    help="Geometric constants to fit: 'J* R?', or none.",
)
holdout_option = click.option(
    "--holdout", default=0.3, show_default=True, type=float, help="Fraction of the poses held out from the fit."
)
in_order_option = click.option(
    "--in-order", is_flag=True,
    help="Rows are in the order of measurement, so that effects may depend on earlier rows.",
)  # fmt: skip
instrument_option = click.option(
    "--instrument",
    metavar="LIMIT",
    help="Instrument's specification, the largest error of a coordinate: '15um + 6um/m'.",
)
condition_limit_option = click.option(
    "--condition-limit", type=float, help="Largest condition number of the standard model. [default: cross-validated]"
)
joints_option = click.option(
    "--joint",
    "joints",
    multiple=True,
    metavar="BALL=RESULT",
    help="Result of a ball joint measured alone, used as prior of ball BALL.",
)
session_option = click.option(
    "--session", is_flag=True, help="Treat row k as row k of the fitted session. [default: the end of the session]"
)


def representation_option(default: str) -> Callable[[Command], Command]:
    """Return the option --representation with a default."""
    return click.option(
        "--representation",
        default=default,
        show_default=True,
        help="Form of the evolved programs: linear, tree, or both.",
    )


SIGHTS = {
    "cameras": "Cameras, and the links that carry them.",
    "board": "Markers of boards, and the links that carry the boards.",
    "surfaces": "Planes, spheres and lines of a known artefact.",
}
"""Help texts of the options for TOML files that describe cameras, boards and touched surfaces."""


def sights_options(command: Command) -> Command:
    """Add the options --cameras, --board and --surfaces to a command."""
    for name, text in reversed(SIGHTS.items()):
        command = click.option(f"--{name}", metavar="FILE", help=f"TOML: {text}")(command)
    return command


table_argument = click.argument("table", type=PATH)
model_argument = click.argument("model", type=PATH)


MECHANISM = (
    ("mechanism", "NAME", "Built-in name, .urdf, or .toml (DH rows, a joint)."),
    ("frame", None, "Measured link, or A,B of two arms. [default: the last]"),
    ("payload", "MASS", "Mass at the tool in every row, as in 60kg."),
    ("payload-com", "X,Y,Z", "Centre of mass of the payload in the measured link: 0,0,90mm."),
)
"""Options of a mechanism: name, placeholder, help."""


def mechanism_options(*, required: bool = True) -> Callable[[Command], Command]:
    """Add --mechanism, --frame, --payload, --payload-com to a command, which receives the loaded `mechanism`."""

    def add(command: Command) -> Command:
        @wraps(command)
        def wrapped(
            *args: object, mechanism: str | None, frame: str | None, payload: str | None, payload_com: str | None,
            **rest: object,
        ) -> object:  # fmt: skip
            said = {"frame": frame, "payload": payload, "payload_com": payload_com}
            if mechanism is None and (alone := next((name for name, value in said.items() if value is not None), None)):
                raise InputError("belongs to a mechanism; expected --mechanism M too", alone)
            loaded = (
                None if mechanism is None else load_mechanism(mechanism, payload, frame=frame, payload_com=payload_com)
            )
            return command(*args, mechanism=loaded, **rest)

        for name, metavar, text in reversed(MECHANISM):
            needed = required and name == "mechanism"
            wrapped = click.option(f"--{name}", required=needed, metavar=metavar, help=text)(wrapped)
        return wrapped  # type: ignore[return-value]

    return add
