"""Print texts and write tables for the commands of gpmodel."""

import contextlib
import math
import re
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import pandas as pd

from gpmodel import wording
from gpmodel.api.model import MODEL, Model
from gpmodel.api.table import with_numbers
from gpmodel.characters import printable, shell_quoted
from gpmodel.cli import terminal
from gpmodel.errors import InputError
from gpmodel.files import write_text
from gpmodel.progress import Progress, Say, silent
from gpmodel.report.schema import Report
from gpmodel.table.cells import read_frame, table_text
from gpmodel.table.robot_programs import is_program
from gpmodel.table.units import split_header

PATIENCE = 10.0
"""Seconds between progress lines on an output that cannot overwrite lines."""
NOISE = {"px": "0.1px", "deg": "0.002deg"}
"""Examples of the option `--noise` for pixels and angles, in messages."""
CLEAR = "\r\x1b[K"
"""Control characters that return to the start of the terminal line and clear the line."""


def path_for(out: Path, default_name: str) -> Path:
    """Return the file named by --out, or `default_name` in the folder --out. Raises InputError for a file of an
    unsupported kind."""
    table = out.suffix.lower() in (".csv", ".txt")
    if out.suffix[1:].isalpha() and not table and not out.is_dir():
        raise InputError(f"{out}: a table is written as .csv; expected such a file, or a folder", "out")
    return out if table and not out.is_dir() else out / default_name


MEASURED = re.compile(r"[xyzuv]|length|(distance|inclination)_.*")
"""Pattern of the names of table columns with measurements."""


def place_for(out: Path | None, default_name: str, source: Path | None = None, read: Path | None = None) -> Path | None:
    """Return the path of a command's output file; None if --out is not given.

    Raises InputError if the file contains measurements that would be lost. Files written by simulate, predict and
    compensate may be replaced; they have a .truth.json next to the table (simulate) or a column sigma (predict,
    compensate).
    source: input table, which may be replaced, because the output keeps the columns of the input.
    read: input table, which may not be replaced.
    """
    path = None if out is None else path_for(out, default_name)
    if path and read and path.exists() and read.exists() and path.samefile(read):
        raise InputError(f"{path} is read by this command; expected another name", "out")
    if (
        path is None
        or not path.is_file()
        or path.with_suffix(".truth.json").exists()
        or (source and source.exists() and path.samefile(source))
    ):
        return path
    names: set[str] = set()
    with contextlib.suppress(InputError):
        names = {split_header(str(name))[0] for name in read_frame(path)[0]}
    if "sigma" not in names and any(map(MEASURED.fullmatch, names)):
        raise InputError(f"{path}: contains measurements, which would be overwritten; expected another name", "out")
    return path


def write_frame(frame: pd.DataFrame, out: Path | None, default_name: str, source: Path | None = None) -> Path | None:
    """Write a table to the file or folder `out`, or to standard output; return the path.

    source: file whose unchanged columns keep the text of their cells.
    """
    if source is not None:
        cells = read_frame(source)[0]
        same = [name for name, given in with_numbers(cells).items() if name in frame and given.equals(frame[name])]
        frame = frame.assign(**{str(name): cells[name] for name in same})
    if out is None:
        terminal.echo(table_text(_in_lines(frame)), nl=False)
        return None
    path = path_for(out, default_name)
    write_text(path, table_text(frame))
    return path


def _in_lines(frame: pd.DataFrame) -> pd.DataFrame:
    """Escape line breaks in headers and cells, so that each row of a printed table is one line."""
    texts = {
        str(name): column.map(lambda cell: printable(cell, "") if isinstance(cell, str) else cell)
        for name, column in frame.items()
        if not pd.api.types.is_numeric_dtype(column)
    }
    return frame.assign(**texts).rename(columns=lambda name: printable(str(name), ""))


class Deliverable(Protocol):
    """Interface of a result with a text for the terminal and a page for a folder."""

    def summary(self) -> str:
        """Return the result as text for a terminal."""

    def report(self, folder: Path) -> object:
        """Write the files of the result into a folder."""


def deliver(found: Deliverable, folder: Path | None, quiet: bool) -> None:
    """Write the files of a result into the folder, if one is given, and then print its summary."""
    if folder is not None:
        found.report(folder)
    if not quiet:
        terminal.echo(found.summary())


def command_line() -> str:
    """Return the command line as typed by the user, for report.json."""
    return " ".join(["gpmodel", *map(shell_quoted, sys.argv[1:])])


def session_note(names: tuple[str, ...], session: bool) -> str:
    """Describe how predictions use effects of the fitted session; sinusoids of one effect are listed once."""
    said = ", ".join(dict.fromkeys(re.sub(r"( [TR][xyz])?, wave \d+$", "", name) for name in names))
    if session:
        return f"row k of this table is treated as row k of the fitted session: {said}"
    return (
        f"predicted for the end of the fitted session: {said}; with --session, row k is treated as row k of the session"
    )


def convention_note(fitted: Model, table: Path) -> str:
    """State the convention in which joint columns of a table were read; "" if it cannot be mistaken for another."""
    known = fitted.saved.convention
    if known is None or known.unchanged or is_program(table):
        return ""
    return f"joint columns of {table.name} are read in the signs and zeros of the description: {known.text}"


def what_next(folder: Path, record: Report) -> str:
    """List the main output file of a calibration or a search, and the commands to use next."""
    model, place = shell_quoted(folder / MODEL), shell_quoted(folder)
    then = [(f"gpmodel predict {model} POSES", "predicted tool positions"),
            (f"gpmodel compensate {model} TARGETS", "corrected joint values")]  # fmt: skip
    if record.effects:
        then += [(f"gpmodel explain {place} 1", "explanation of the first finding"),
                 (f"gpmodel poses --after {place} -n 12", "poses to measure next")]  # fmt: skip
    if not record.unseen:
        then += [(f"gpmodel certificate {place}", "accuracy certificate, to print or save as PDF")]
    if (folder / "exports").is_dir():
        then += [(f"gpmodel export {place}", "URDF, DH rows, NumPy, C99, lookup grid")]
    if record.kind == "calibrate":
        then += [("gpmodel discover TABLE --mechanism M", "search for missing effects")]
    widest = max(len(command) for command, _ in then)
    below = widest + max(len(what) for _, what in then) + 4 > wording.WIDTH
    lines = [f"  {command}\n      {what}" if below else f"  {command:<{widest}}  {what}" for command, what in then]
    if record.noise_floor_mm is None:
        size = next((NOISE[r.unit] for r in record.readings if r.unit in NOISE), "0.03mm")
        option = f"--noise {size}" if record.kind == "discover" else "--instrument '15um + 6um/m'"
        lines.append(f"  give {option} or measure repeats, to know the noise floor")
    return "\n".join([f"report: {folder / 'report.html'}", "next:", *lines])


@contextlib.contextmanager
def progress_line(quiet: bool) -> Iterator[Say]:
    """Print progress messages with the elapsed time on standard error.

    On a terminal each message overwrites the last one; on another output a message is printed every ten seconds.
    """
    if quiet:
        yield silent
        return
    shown = sys.stderr.isatty()
    started = time.monotonic()
    printed = -math.inf

    def say(progress: Progress) -> None:
        nonlocal printed
        now = time.monotonic()
        line = f"{now - started:5.0f} s  {progress}"
        if progress.passing and shown:
            terminal.echo(line[: shutil.get_terminal_size().columns - 1], nl=False, err=True, lead=CLEAR)
        elif not progress.passing or now > printed + PATIENCE:
            printed = now if progress.passing else printed
            terminal.echo(line, err=True, lead=CLEAR if shown else "")

    try:
        yield say
    finally:
        if shown:
            terminal.echo("", nl=False, err=True, lead=CLEAR)
