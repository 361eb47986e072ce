"""Results on disk: whole or not at all."""

import json
import math
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from gpmodel.errors import InputError

_NUMBERS = re.compile(r"\[\n[-+0-9.eE,\snul]*\]")


def folder_for(out: Path) -> Path:
    """`out` again. Raises InputError when it is a file, before anything is computed for it."""
    if out.exists() and not out.is_dir():
        raise InputError(f"{out} is a file; expected a folder", "folder")
    return out


@contextmanager
def finished_folder(out: Path) -> Iterator[Path]:
    """A fresh folder beside `out`; what is in it replaces files of the same name in `out` only when all went well.

    Raises InputError when `out` is a file or cannot be made.
    """
    folder_for(out)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.parent))
    except OSError as error:
        raise InputError(f"{out} cannot be written ({error.strerror})", "folder") from None
    try:
        yield draft
        draft.chmod(0o777 & ~_umask())
        if out.exists():
            for path in sorted(p for p in draft.rglob("*") if p.is_file()):
                target = out / path.relative_to(draft)
                target.parent.mkdir(parents=True, exist_ok=True)
                os.replace(path, target)
        else:
            os.replace(draft, out)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def write_text(path: Path, text: str) -> None:
    """Write `text` to `path` through a file beside it, so that no reader ever sees half of it.

    Raises InputError when it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, draft = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="") as file:
                file.write(text)
            os.chmod(draft, 0o666 & ~_umask())
            os.replace(draft, path)
        finally:
            Path(draft).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None


def to_json(value: object) -> str:
    """JSON text of nested dicts, sequences and NumPy numbers; a row of numbers is a line, not finite ones are null."""
    text = json.dumps(_plain(value), indent=1, ensure_ascii=False, allow_nan=False)
    return _NUMBERS.sub(lambda found: re.sub(r"\n\s*", "", found[0]).replace(",", ", "), text) + "\n"


def _plain(value: object) -> object:
    match value:
        case dict():
            return {str(k): _plain(v) for k, v in value.items()}
        case list() | tuple():
            return [_plain(v) for v in value]
        case np.ndarray():
            return _plain(value.tolist())
        case np.generic():
            return _plain(value.item())
        case float():
            return value if math.isfinite(value) else None
        case Path():
            return str(value)
    return value


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
