"""A URDF file read by Pinocchio: what is wrong with it comes as one line, and nothing else is printed."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pinocchio as pin

from gpmodel.errors import InputError


def parse_model(path: Path) -> pin.Model:
    """Pinocchio's model of the file, no mesh opened. Raises InputError with the parser's first complaint, also where it
    would go on without the inertia that it complains of."""
    try:
        with _quiet() as said:
            model = pin.buildModelFromUrdf(str(path))
        if any("inertial" in line for line in said):
            raise ValueError(said)
        return model
    except (ValueError, RuntimeError) as error:
        complaint = next((line for line in said if line.strip()), str(error).splitlines()[0])
        raise InputError(
            f"{path}: not a URDF that can be read ({complaint.strip().removeprefix('Error:').strip()})"
        ) from error


@contextmanager
def _quiet() -> Iterator[list[str]]:
    """Keeps what C libraries print off the terminal; the lines are in the yielded list afterwards."""
    lines: list[str] = []
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(1), os.dup(2)]
    with tempfile.TemporaryFile("w+", errors="replace") as sink:
        try:
            os.dup2(sink.fileno(), 1)
            os.dup2(sink.fileno(), 2)
            yield lines
        finally:
            for stream, copy in zip((1, 2), kept, strict=True):
                os.dup2(copy, stream)
                os.close(copy)
            sink.seek(0)
            lines.extend(sink)
