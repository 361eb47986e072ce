"""Memory that was freed and that the allocator keeps."""

import ctypes
import sys


def give_back() -> None:
    """Give it to the system, where the C library can: glibc keeps what arrays of up to 32 MB had, hundreds of megabytes
    after a search, beside which larger ones are allocated anew."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim:
        trim(0)
