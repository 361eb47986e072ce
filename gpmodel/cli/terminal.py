"""Text on standard output and standard error, whatever they take: what is printed was saved before."""

import errno
import os
import sys
from contextlib import suppress

import click

from gpmodel.characters import PLAIN, printable

_failed: list[str] = []
"""Why standard output took no more, in this run of the program."""


def begin() -> None:
    """Let both streams write characters that their encoding lacks in ASCII: − as -, ×10⁻⁶ as x10^-6."""
    _failed.clear()
    for stream in (sys.stdout, sys.stderr):
        if getattr(stream, "errors", None) == "strict" and hasattr(stream, "reconfigure"):
            with suppress(OSError, ValueError):
                stream.reconfigure(errors=PLAIN)


def failed() -> str:
    """Return why standard output took no more; empty where it took all, or its reader left."""
    return _failed[0] if _failed else ""


def echo(text: str, *, err: bool = False, nl: bool = True, lead: str = "") -> None:
    """Print a text. A stream that fails, a closed pipe or a full disk, is given up and ends nothing.

    lead: control characters before it.
    """
    stream = sys.stderr if err else sys.stdout
    try:
        click.echo(lead + printable(text), nl=nl, err=err)
    except OSError as error:
        if not err and error.errno not in (errno.EPIPE, errno.EINVAL):
            _failed.append(error.strerror or str(error))
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
