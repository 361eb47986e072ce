"""Print to standard output and standard error without failing; results are saved before the printing."""

import errno
import os
import sys
from contextlib import suppress

import click

from gpmodel.characters import PLAIN, printable

_failed: list[str] = []
"""Reason why standard output failed, in this run of the program."""


def begin() -> None:
    """Replace characters that the encoding of an output stream lacks by ASCII: − by -, ×10⁻⁶ by x10^-6."""
    _failed.clear()
    for stream in (sys.stdout, sys.stderr):
        if getattr(stream, "errors", None) == "strict" and hasattr(stream, "reconfigure"):
            with suppress(OSError, ValueError):
                stream.reconfigure(errors=PLAIN)


def failed() -> str:
    """Return the reason why standard output failed; empty if the text was written or the reader closed the pipe."""
    return _failed[0] if _failed else ""


def echo(text: str, *, err: bool = False, nl: bool = True, lead: str = "") -> None:
    """Print a text. After a first failure of a stream (closed pipe, full disk), nothing is printed to the stream.

    lead: control characters printed before the text.
    """
    stream = sys.stderr if err else sys.stdout
    try:
        click.echo(lead + printable(text), nl=nl, err=err)
    except OSError as error:
        if not err and error.errno not in (errno.EPIPE, errno.EINVAL):
            _failed.append(error.strerror or str(error))
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
