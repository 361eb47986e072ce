"""Run independent tasks in parallel, in threads or processes of this computer.

A task contains all its data, including a random generator. The result of a task does not depend on the worker, on the
order of the tasks, or on how often the task was restarted.
"""

import copyreg
import gc
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
"""Longest time, s, that a thread keeps the interpreter. A compiled loop of a generation takes about 1 ms; with Python's
default of 5 ms a finished thread would wait longer than its computing time."""

AHEAD = 2
"""Number of tasks queued per worker. Two keep every worker busy and memory independent of the number of tasks."""

ATTEMPTS = 3
"""Number of lost processes in sequence after which a task is assumed to kill them (`allowed-failures` of dask)."""


def read_only(columns: dict[str, object]) -> MappingProxyType[str, object]:
    """Return columns of a table as read-only arrays, called by pickle in the receiving process."""
    return MappingProxyType(columns)


copyreg.pickle(MappingProxyType, lambda columns: (read_only, (dict(columns),)))


class Workers(Protocol):
    """Type of a function that runs tasks in parallel."""

    def __call__(self, function: Callable[[Task], Found], tasks: Sequence[Task], /) -> Iterator[tuple[int, Found]]:
        """Yield the number and result of each task as the task finishes; unstarted tasks are cancelled if the caller
        stops."""


def cores() -> int:
    """Return the number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Threads:
    """Workers that are threads of this process. workers: number of threads, 0 for one per core.

    Compiled loops and linear algebra run in parallel; Python code does not run in parallel.
    """

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
    """Run function calls in parallel on workers; return the results in the order of the calls."""
    found = dict(workers(lambda call: call(), calls))
    return [found[number] for number in range(len(calls))]


def lost_replaced(
    opened: Callable[[], AbstractContextManager[Executor]],
    function: Callable[[Task], Found],
    tasks: Sequence[Task],
    ahead: int,
    call: Callable[[], None] | None = None,
) -> Iterator[tuple[int, Found]]:
    """Yield number and result of tasks as they finish; open a new process pool if a process is lost.

    call: function called once in this process while the tasks run.
    Raises BrokenProcessPool after three losses of processes without a result in between.
    """
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
    """Yield number and result of tasks as they finish, with at most `ahead` tasks queued.

    call: function called once in this process after the first tasks are queued.
    """
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
    """Let threads switch every 0.1 ms (SWITCH), and restore the former interval afterwards."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(SWITCH, before))
    try:
        yield
    finally:
        sys.setswitchinterval(before)


Beside = TypeVar("Beside")


@dataclass(frozen=True)
class Forks:
    """Forked copies of this process. workers: number of copies, 0 for one per core.

    A copy inherits all loaded modules and data; only results are pickled. A task with a result that cannot be pickled
    runs again in this process.
    Threads replace copies on Windows and macOS, after `multiprocessing.set_start_method` with a method other than fork,
    and while other threads run, because a thread may hold a lock during the fork. A copy runs its own tasks one by one.
    """

    workers: int = 0

    def __call__(self, function: Callable[[Task], Found], tasks: Sequence[Task], /) -> Iterator[tuple[int, Found]]:
        """Yield number and result of each task as it finishes. Raises BrokenProcessPool if a task loses processes."""
        yield from self._beside(function, tasks, None)

    def beside(self, call: Callable[[], None], calls: Sequence[Callable[[], Found]]) -> Iterator[tuple[int, Found]]:
        """Run `calls` in copies and `call` in this process; then yield number and result of each of the `calls`."""
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
                with warnings.catch_warnings():  # about threads of BLAS, which restarts them in a copy
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
    """Return whether this process can be forked safely."""
    forked = multiprocessing.get_start_method(allow_none=True) in (None, "fork")
    return sys.platform == "linux" and forked and threading.active_count() == 1


ALONE = Forks(1)
"""Workers that run one task after another in this process."""


def called_beside(
    workers: Forks, call: Callable[[], Beside], calls: Sequence[Callable[[], Found]]
) -> tuple[Beside, list[Found]]:
    """Run `call` in this process and `calls` in forked copies at the same time; return all results."""
    made: list[Beside] = []
    found = dict(workers.beside(lambda: made.append(call()), calls))
    return made[0], [found[number] for number in range(len(calls))]


_inherited: list[tuple[Callable[..., object], Sequence[object]]] = []
"""The function and the tasks for which a forked copy was made."""


def _as_copy(ends: tuple[Connection, Connection], function: Callable[..., object], tasks: Sequence[object]) -> None:
    """Initialise a forked copy, which exits when its parent process ends or closes its end of the pipe."""
    reader, writer = ends
    writer.close()
    gc.freeze()
    _inherited.append((function, tasks))

    def watch() -> None:
        reader.poll(None)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _inherited_task(number: int) -> bytes | None:
    """Return the pickled result of a task; None if the result cannot be pickled, such as an effect of a user's
    function."""
    function, tasks = _inherited[-1]
    found = function(tasks[number])
    try:
        return pickle.dumps(found)
    except (pickle.PicklingError, AttributeError, TypeError):
        return None
