"""Slices of one run over threads: the same numbers whatever their number."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

SLICE = 512
"""Programs that a thread works on at once: their registers stay in its cache."""


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="gpmodel")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.cache_clear)


def over_slices(count: int, threads: int, work: Callable[[slice], None], size: int = SLICE) -> None:
    """Call ``work`` on fixed slices of ``range(count)``; the slices do not depend on ``threads``."""
    slices = [slice(begin, min(begin + size, count)) for begin in range(0, count, size)]
    if threads == 1 or len(slices) == 1:
        for part in slices:
            work(part)
    else:
        list(_pool(threads).map(work, slices))
