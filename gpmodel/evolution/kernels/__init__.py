"""Compiled inner loops of genetic programming (numba), tested against NumPy versions."""

from contextlib import suppress
from pathlib import Path


def drop_stale_cache() -> None:
    """Remove compiled code that is older than the source of any compiled loop.
    The compiler's cache checks the file of the outermost function only, not the files of the functions it calls."""
    here = Path(__file__).parent
    newest = max(source.stat().st_mtime for source in here.glob("*.py"))
    for index in (here / "__pycache__").glob("*.nbi"):
        with suppress(OSError):
            if index.stat().st_mtime < newest:
                index.unlink()


drop_stale_cache()
