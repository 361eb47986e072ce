"""Work over threads, slices of one run or whole runs: the same numbers whatever their number."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Task = TypeVar("Task")
Found = TypeVar("Found")

SLICE = 512


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


def side_by_side(function: Callable[[Task], Found], tasks: Sequence[Task], threads: int) -> Iterator[Found]:
    """``function`` of every task, in their order, ``threads`` at a time (0 for all cores); what is left is dropped.

    The compiled loops and the linear algebra, on one thread each, let the others run.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(threads or cores()) as pool:
        waiting = [pool.submit(function, task) for task in tasks]
        try:
            for future in waiting:
                yield future.result()
        finally:
            for future in waiting:
                future.cancel()
