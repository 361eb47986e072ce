"""What the command line prints, and tables it writes."""

import sys
from pathlib import Path

import click
import pandas as pd
from rich.console import Console

from gpmodel.files import write_text
from gpmodel.table.write import table_text


def console_for_text() -> Console:
    """Standard output for tables: as wide as the terminal, wide enough for any table where there is none."""
    return Console(highlight=False, width=None if sys.stdout.isatty() else 140)


def path_for(out: Path, default_name: str) -> Path:
    """The file meant by --out: itself, or one of that name in a folder."""
    return out if out.suffix.lower() in (".csv", ".txt") and not out.is_dir() else out / default_name


def write_frame(frame: pd.DataFrame, out: Path | None, default_name: str) -> Path | None:
    """Write a table to the file `out`, into the folder `out`, or to standard output; the path written."""
    text = table_text(frame)
    if out is None:
        click.echo(text, nl=False)
        return None
    path = path_for(out, default_name)
    write_text(path, text)
    return path


def command_line() -> str:
    """What was typed, for the record."""
    return " ".join(["gpmodel", *sys.argv[1:]])
