"""Independent tasks side by side, in threads or in processes of this machine.

A task carries all it needs, its random generator included, so that no number depends on where it ran, in what order,
or how often it was begun again.
"""

import copyreg
import multiprocessing
import os
import pickle
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing.connection import Connection
from queue import SimpleQueue
from types import MappingProxyType
from typing import Protocol, TypeVar

Task = TypeVar("Task")
Found = TypeVar("Found")

SWITCH = 1e-4
"""Seconds after which a thread yields the interpreter. A compiled loop of a generation takes about a millisecond; with
Python's 5 ms a finished thread would wait longer than it works."""

AHEAD = 2
"""Tasks handed out per worker: two keep every worker busy, and memory does not grow with the number of tasks."""

ATTEMPTS = 3
"""Lost processes in a row after which the task counts as their cause, as in dask (`allowed-failures`)."""


def read_only(columns: dict[str, object]) -> MappingProxyType[str, object]:
    """Read-only columns; as which they arrive at another process."""
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


Beside = TypeVar("Beside")


@dataclass(frozen=True)
class Forks:
    """Copies of this process, with all that it has loaded and read; 0 for one a core. Results alone are pickled; a task
    whose result cannot be is done here.

    Threads instead where a system has no copies (Windows) or its libraries bear none (macOS), where a start method
    other than fork was set (`multiprocessing.set_start_method`), and where other threads run, which may hold a lock at
    that moment; in a copy itself one task after another.
    """

    workers: int = 0

    def __call__(self, function: Callable[[Task], Found], tasks: Sequence[Task], /) -> Iterator[tuple[int, Found]]:
        """Run the tasks; see Workers. Raises BrokenProcessPool if a task loses its process repeatedly."""
        yield from self._beside(function, tasks, None)

    def beside(self, call: Callable[[], None], calls: Sequence[Callable[[], Found]]) -> Iterator[tuple[int, Found]]:
        """Run calls in copies and another call here, which ends before the first result is returned."""
        yield from self._beside(lambda task: task(), calls, call)

    def _beside(
        self, function: Callable[[Task], Found], tasks: Sequence[Task], call: Callable[[], None] | None
    ) -> Iterator[tuple[int, Found]]:
        workers = self.workers or cores()
        count = min(workers, len(tasks))
        alone = workers == 1 or count + (call is not None) <= 1
        if alone or _inherited or not _copies():
            if call:
                call()
            yield from Threads(1 if _inherited else self.workers)(function, tasks)
            return
        from threadpoolctl import threadpool_limits

        @contextmanager
        def opened() -> Iterator[Executor]:
            context = multiprocessing.get_context("fork")
            ends = reader, writer = context.Pipe(duplex=False)
            with reader, writer, ProcessPoolExecutor(count, context, _as_copy, (ends, function, tasks)) as pool:
                with warnings.catch_warnings():  # of threads of the linear algebra, which it begins anew in a copy
                    warnings.simplefilter("ignore", DeprecationWarning)
                    pool.submit(os.getpid)
                try:
                    yield pool
                except BaseException:
                    writer.close()
                    raise

        ahead = len(tasks) if call else AHEAD * count
        with threadpool_limits(1, user_api="blas"):
            for number, found in lost_replaced(opened, _inherited_task, range(len(tasks)), ahead, call):
                yield number, function(tasks[number]) if found is None else pickle.loads(found)


def _copies() -> bool:
    """Return whether this process can be copied."""
    forked = multiprocessing.get_start_method(allow_none=True) in (None, "fork")
    return sys.platform == "linux" and forked and threading.active_count() == 1


ALONE = Forks(1)
"""Workers that run one task after another."""


def called_beside(
    workers: Forks, call: Callable[[], Beside], calls: Sequence[Callable[[], Found]]
) -> tuple[Beside, list[Found]]:
    """Return the result of a call made here and the results of calls made in copies meanwhile."""
    made: list[Beside] = []
    found = dict(workers.beside(lambda: made.append(call()), calls))
    return made[0], [found[number] for number in range(len(calls))]


_inherited: list[tuple[Callable[..., object], Sequence[object]]] = []
"""In a copy of a process: the function and the tasks that it was made for."""


def _as_copy(ends: tuple[Connection, Connection], function: Callable[..., object], tasks: Sequence[object]) -> None:
    """Make this copy ready for its tasks; it ends when the process it was made of closes its end, or ends itself."""
    reader, writer = ends
    writer.close()
    _inherited.append((function, tasks))

    def watch() -> None:
        reader.poll(None)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _inherited_task(number: int) -> bytes | None:
    """The result of a task as bytes; None where it cannot be pickled, as with an effect of a user's own function."""
    function, tasks = _inherited[-1]
    found = function(tasks[number])
    try:
        return pickle.dumps(found)
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
