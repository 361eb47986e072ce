"""Independent tasks side by side, in threads or in processes of this machine.

A task carries all it needs, its random generator included, so that no number depends on where it ran, in what order,
or how often it was begun again.
"""

import copyreg
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import islice
from queue import SimpleQueue
from types import MappingProxyType
from typing import Protocol, TypeVar

Task = TypeVar("Task")
Found = TypeVar("Found")

SWITCH = 1e-4
"""Seconds after which a thread gives way to another that waits for the interpreter. The compiled loops of a generation
take about a millisecond each: with Python's 5 ms a thread that comes out of one would wait longer than it worked."""

AHEAD = 2
"""Tasks handed out for each worker: enough that none waits, few enough that memory does not grow with their number."""

ATTEMPTS = 3
"""Number of lost processes in a row before the task is blamed, as in dask (`allowed-failures`)."""


def read_only(columns: dict[str, object]) -> MappingProxyType[str, object]:
    """Columns that nobody changes; as which they arrive at another process."""
    return MappingProxyType(columns)


copyreg.pickle(MappingProxyType, lambda columns: (read_only, (dict(columns),)))


class Workers(Protocol):
    """Runs tasks side by side."""

    def __call__(self, function: Callable[[Task], Found], tasks: Sequence[Task], /) -> Iterator[tuple[int, Found]]:
        """(place in `tasks`, result) of every task, as they finish; tasks that nobody waits for are not begun."""


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Threads:
    """Threads of this process; 0 for one a core. The compiled loops and the linear algebra let the others run, Python
    does not."""

    workers: int = 0

    def __call__(self, function: Callable[[Task], Found], tasks: Sequence[Task], /) -> Iterator[tuple[int, Found]]:
        from threadpoolctl import threadpool_limits

        count = min(self.workers or cores(), len(tasks))
        if count <= 1:
            yield from ((number, function(task)) for number, task in enumerate(tasks))
            return
        with threadpool_limits(1, user_api="blas"), _short_turns(), ThreadPoolExecutor(count) as pool:
            yield from _as_finished(pool, function, dict(enumerate(tasks)), AHEAD * count)


def called(workers: Workers, calls: Sequence[Callable[[], Found]]) -> list[Found]:
    """Return the results of calls made in parallel."""
    found = dict(workers(lambda call: call(), calls))
    return [found[number] for number in range(len(calls))]


@dataclass(frozen=True)
class Processes:
    """New processes of this machine, for tasks that are pickled; 0 for one a core. One that is lost is replaced."""

    workers: int = 0

    def __call__(self, function: Callable[[Task], Found], tasks: Sequence[Task], /) -> Iterator[tuple[int, Found]]:
        """Run the tasks; see Workers. Raises BrokenProcessPool if a task loses its process repeatedly."""
        count = min(self.workers or cores(), len(tasks))
        context = multiprocessing.get_context("spawn")
        yield from lost_replaced(lambda: ProcessPoolExecutor(count, context), function, tasks, AHEAD * count)


def lost_replaced(
    opened: Callable[[], AbstractContextManager[Executor]],
    function: Callable[[Task], Found],
    tasks: Sequence[Task],
    ahead: int,
    call: Callable[[], None] | None = None,
) -> Iterator[tuple[int, Found]]:
    """(number, result) of tasks as they finish in a pool, in another one where it has lost a process. call: made once,
    while they run."""
    left, lost, once = dict(enumerate(tasks)), 0, iter([call] if call else [])
    while left:
        try:
            with opened() as pool:
                for number, found in _as_finished(pool, function, left, ahead, next(once, None)):
                    lost = 0
                    del left[number]
                    yield number, found
        except BrokenProcessPool:
            lost += 1
            if lost == ATTEMPTS:
                raise


def _as_finished(
    pool: Executor,
    function: Callable[[Task], Found],
    tasks: dict[int, Task],
    ahead: int,
    call: Callable[[], None] | None = None,
) -> Iterator[tuple[int, Found]]:
    """(number, result) of tasks as they finish, no more than `ahead` of them handed out at a time. call: made once the
    first are handed out."""
    waiting = iter(list(tasks.items()))
    running: dict[Future[Found], int] = {}
    finished: SimpleQueue[Future[Found]] = SimpleQueue()

    def hand_out() -> None:
        for number, task in islice(waiting, 1):
            future = pool.submit(function, task)
            running[future] = number
            future.add_done_callback(finished.put)

    try:
        for _ in range(ahead):
            hand_out()
        if call:
            call()
        while running:
            future = finished.get()
            number = running.pop(future)
            hand_out()
            yield number, future.result()
    finally:
        for future in running:
            future.cancel()


@contextmanager
def _short_turns() -> Iterator[None]:
    """Threads take turns every `SWITCH` seconds, and as before afterwards."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(SWITCH, before))
    try:
        yield
    finally:
        sys.setswitchinterval(before)
