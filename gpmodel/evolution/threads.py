"""Work over threads, slices of one run or whole runs: the same numbers whatever their number."""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

Task = TypeVar("Task")
Found = TypeVar("Found")

SLICE = 512

SWITCH = 1e-4
"""Seconds after which a thread gives way to another that waits for the interpreter. The compiled loops of a generation
take about a millisecond each: with Python's 5 ms a thread that comes out of one would wait longer than it worked."""


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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


@contextmanager
def _short_turns() -> Iterator[None]:
    """Threads take turns every `SWITCH` seconds, and as before afterwards."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(SWITCH, before))
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def side_by_side(function: Callable[[Task], Found], tasks: Sequence[Task], threads: int) -> Iterator[Found]:
    """``function`` of every task, in their order, ``threads`` at a time (0 for all cores); what is left is dropped.

    The compiled loops and the linear algebra, on one thread each, let the others run; several threads take turns
    (`SWITCH`) while it lasts.
    """
    from threadpoolctl import threadpool_limits

    count = min(threads or cores(), len(tasks))
    if count <= 1:
        yield from map(function, tasks)
        return
    with threadpool_limits(1, user_api="blas"), _short_turns(), ThreadPoolExecutor(count) as pool:
        waiting = [pool.submit(function, task) for task in tasks]
        try:
            for future in waiting:
                yield future.result()
        finally:
            for future in waiting:
                future.cancel()
