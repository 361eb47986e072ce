"""Files from outside, read within a limit: a device or a pipe may never end."""

import stat
from pathlib import Path

from gpmodel.errors import InputError


def read_limited(path: Path, largest: int, expected: str) -> bytes:
    """The bytes of a regular file of `largest` bytes at most.

    Raises InputError, saying what was `expected`: it cannot be read, is a device or a pipe, or is larger.
    """
    try:
        kind = path.stat().st_mode
        if not stat.S_ISREG(kind) and not stat.S_ISDIR(kind):
            raise InputError(f"{path}: a device or a pipe, not a regular file; expected {expected}")
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected {expected}") from None
    if len(content) > largest:
        raise InputError(f"{path}: larger than {largest >> 20} MB; expected {expected} of less")
    return content


def read_text(path: Path, largest: int, expected: str) -> str:
    """The text of such a file in UTF-8. Raises InputError as read_limited, and where it is no text."""
    try:
        return read_limited(path, largest, expected).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: is no text in UTF-8 ({error.reason}); expected {expected}") from None
