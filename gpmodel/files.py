"""Write results to disk completely or not at all, one process at a time."""

import errno
import json
import math
import os
import re
import shutil
import socket
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from functools import cache
from pathlib import Path

import numpy as np

from gpmodel.errors import InputError, WriteError

LOCK = ".gpmodel.lock"
_NUMBERS = {int, float, type(None)}
_DRAFT = ".gpmodel-draft"
_held = set[Path]()
"""Output folders locked by this process of gpmodel."""
SYNCHRONIZE, STILL_RUNNING = 0x100000, 0x102
"""Windows API: access right to wait for a process, and the return code of a process that still runs (WAIT_TIMEOUT)."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def folder_for(out: Path) -> Path:
    """Check the output folder `out` before any computation; InputError if it or a parent is a file or a broken link."""
    first = next((path for path in (out, *out.parents) if path.exists() or path.is_symlink()), Path())
    if not first.is_dir():
        what = "a file" if first.exists() else "a link to nothing"
        raise InputError(f"{first} is {what}; expected a folder", "folder")
    return out


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Create `folder` and lock it. The operating system releases the lock when the process ends, also after a crash.

    The folder is removed afterwards if it is empty. Raises InputError if another process holds the lock, WriteError if
    the folder cannot be created.
    """
    from filelock import FileLock, Timeout

    missing = next((p for p in reversed((folder, *folder.parents)) if not p.exists()), None)
    with as_write_error(folder):
        folder_for(folder).mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / LOCK, timeout=0)
        try:
            lock.acquire()
        except Timeout:
            message = "another gpmodel process uses this folder; wait for its end, or choose another folder"
            raise InputError(f"{folder}: {message}") from None
        except NotImplementedError:
            pass  # a file system without locks
    held = folder.resolve()
    _held.add(held)
    try:
        yield
    finally:
        _held.discard(held)
        with suppress(OSError):
            (folder / LOCK).unlink(missing_ok=True)  # before the release, since another process may lock it then
        lock.release()
        with suppress(OSError):
            while missing is not None and folder.is_relative_to(missing):
                folder.rmdir()
                folder = folder.parent


@contextmanager
def finished_folder(out: Path) -> Iterator[Path]:
    """Yield a temporary folder, whose files replace the files in `out` only if the caller's code ends without an error.

    Raises InputError if `out` is a file or another process works in `out`, WriteError if a file cannot be written.
    """
    folder_for(out)
    alone = locked_folder(out) if out.is_dir() and out.resolve() not in _held else nullcontext()
    with alone, as_write_error(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        place = out if out.exists() else out.parent
        _sweep(place.resolve())
        draft = Path(tempfile.mkdtemp(prefix=_mine(), dir=place))
        try:
            yield draft
            draft.chmod(0o777 & ~_umask())
            if out.exists():
                moves = {p: out / p.relative_to(draft) for p in sorted(draft.rglob("*")) if p.is_file()}
                if clash := [t for t in moves.values() if t.is_dir() or t.parent.is_file()]:
                    raise WriteError(f"{clash[0]}: a file and a folder have this name; expected another --out")
                for path, target in moves.items():
                    target.parent.mkdir(parents=True, exist_ok=True)
                    os.replace(path, target)
            else:
                os.replace(draft, out)
        except WriteError as error:
            raise WriteError(str(error).replace(str(draft), str(out))) from None
        finally:
            shutil.rmtree(draft, ignore_errors=True)


def remove_files(folder: Path, patterns: Sequence[str]) -> None:
    """Remove the files of a folder whose names match a pattern. Raises WriteError if a file cannot be removed."""
    for path in [path for pattern in patterns for path in folder.glob(pattern)]:
        with as_write_error(path):
            path.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write text in UTF-8, so that the file is never half-written. Undecodable characters are written as escapes."""
    write_bytes(path, text.encode(errors="backslashreplace"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write `content` to a temporary file and rename it to `path`, so that `path` is never half-written, even after a
    power cut.

    Raises WriteError if the file cannot be written.
    """
    with as_write_error(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep(path.parent.resolve())
        handle, draft = tempfile.mkstemp(prefix=_mine(), dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            os.chmod(draft, 0o666 & ~_umask())
            os.replace(draft, path)
        finally:
            Path(draft).unlink(missing_ok=True)


def remove_folder(folder: Path) -> None:
    """Remove a folder in one step. If the process is killed meanwhile, the next write removes the rest."""
    if folder.exists():
        with as_write_error(folder):
            aside = Path(tempfile.mkdtemp(prefix=_mine(), dir=folder.parent))
            os.replace(folder, aside / folder.name)
        shutil.rmtree(aside, ignore_errors=True)


def mark_damaged(path: Path) -> Path:
    """Rename a damaged file to `NAME.damaged`, so that it is kept but not read again; return the new path."""
    aside = path.with_name(f"{path.name}.damaged")
    with as_write_error(path):
        os.replace(path, aside)
    return aside


@contextmanager
def as_write_error(path: Path) -> Iterator[None]:
    """Convert an OSError of a file beside or below `path` to a WriteError that names `path`; pass on other errors."""
    try:
        yield
    except OSError as error:
        failed = Path(error.filename) if isinstance(error.filename, str) else path
        if not failed.absolute().is_relative_to(path.absolute().parent):
            raise
        hint = "; free some space, or choose another folder" if error.errno in _FULL else ""
        raise WriteError(f"{path}: cannot be written ({error.strerror or error}){hint}") from None


def to_json(value: object) -> str:
    """Return JSON text of nested dicts, sequences and NumPy numbers. A list of numbers is written as one line of JSON;
    non-finite numbers are null."""
    return "".join(_laid_out(plain(value), "\n")) + "\n"


def plain(value: object) -> object:
    """Convert a value to JSON types: NumPy numbers and arrays to numbers and lists, non-finite values to null."""
    match value:
        case dict():
            return {str(k): plain(v) for k, v in value.items()}
        case list() | tuple():
            return [plain(v) for v in value]
        case np.ndarray() if value.dtype.kind == "f" and np.isfinite(value).all():
            return value.tolist()
        case np.ndarray():
            return plain(value.tolist())
        case np.generic():
            return plain(value.item())
        case float():
            return value if math.isfinite(value) else None
        case Path():
            return str(value)
    return value


def _laid_out(value: object, line: str) -> Iterator[str]:
    """Yield the parts of JSON text, one entry per line. line: line break and indentation of the enclosing level."""
    inner = f"{line} "
    match value:
        case dict() if value:
            for k, (name, part) in enumerate(value.items()):
                yield f"{',' if k else '{'}{inner}{json.dumps(name, ensure_ascii=False)}: "
                yield from _laid_out(part, inner)
            yield f"{line}}}"
        case list() if not _NUMBERS.issuperset(map(type, value)):
            for k, part in enumerate(value):
                yield f"{',' if k else '['}{inner}"
                yield from _laid_out(part, inner)
            yield f"{line}]"
        case _:
            yield json.dumps(value, ensure_ascii=False, allow_nan=False)


def _mine() -> str:
    """Return the name prefix of this process's temporary files."""
    return f"{_DRAFT}-{socket.gethostname()}-{os.getpid()}-"


@cache
def _sweep(folder: Path) -> None:
    """Remove temporary files of ended processes of this computer, once per folder and process."""
    pattern = re.compile(rf"{re.escape(f'{_DRAFT}-{socket.gethostname()}-')}(\d+)-")
    for path in folder.iterdir():
        found = pattern.match(path.name)
        if found and int(found[1]) != os.getpid() and not _alive(int(found[1])):
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)


def _alive(process: int) -> bool:
    """Return whether a process of this computer runs. On Windows the process is opened, since signal 0 means Ctrl-C on
    Windows."""
    if sys.platform == "win32":
        import ctypes

        handle = ctypes.windll.kernel32.OpenProcess(SYNCHRONIZE, False, process)
        running = handle and ctypes.windll.kernel32.WaitForSingleObject(handle, 0) == STILL_RUNNING
        ctypes.windll.kernel32.CloseHandle(handle)
        return bool(running)
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
