"""Independent tasks side by side, in threads, in processes or on other machines.

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
from contextlib import contextmanager
from dataclasses import dataclass
from queue import SimpleQueue
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol, TypeVar

from gpmodel.errors import InputError

if TYPE_CHECKING:
    from distributed import Client
    from distributed import Future as DaskFuture

Task = TypeVar("Task")
Found = TypeVar("Found")

SWITCH = 1e-4
"""Seconds after which a thread gives way to another that waits for the interpreter. The compiled loops of a generation
take about a millisecond each: with Python's 5 ms a thread that comes out of one would wait longer than it worked."""

AHEAD = 2
"""Tasks handed out for each worker: enough that none waits, few enough that memory does not grow with their number."""

ATTEMPTS = 3
"""How often in a row processes may be lost before the task is to blame, as in dask (`allowed-failures`)."""

PATIENCE = "10s"
"""For which a scheduler may be silent."""


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
    """Threads of this process; 0 for one a core. The compiled loops and the linear algebra let the others run."""

    workers: int = 0

    def __call__(self, function: Callable[[Task], Found], tasks: Sequence[Task], /) -> Iterator[tuple[int, Found]]:
        """As Workers."""
        from threadpoolctl import threadpool_limits

        count = min(self.workers or cores(), len(tasks))
        if count <= 1:
            yield from ((number, function(task)) for number, task in enumerate(tasks))
            return
        with threadpool_limits(1, user_api="blas"), _short_turns(), ThreadPoolExecutor(count) as pool:
            yield from _as_finished(pool, function, dict(enumerate(tasks)), AHEAD * count)


@dataclass(frozen=True)
class Processes:
    """Processes of this machine, for what holds the interpreter; 0 for one a core. One that is lost is replaced."""

    workers: int = 0

    def __call__(self, function: Callable[[Task], Found], tasks: Sequence[Task], /) -> Iterator[tuple[int, Found]]:
        """As Workers. Raises BrokenProcessPool where a task loses its process again and again."""
        count = min(self.workers or cores(), len(tasks))
        left, lost = dict(enumerate(tasks)), 0
        while left:
            try:
                with ProcessPoolExecutor(count, multiprocessing.get_context("spawn")) as pool:
                    for number, found in _as_finished(pool, function, left, AHEAD * count):
                        lost = 0
                        del left[number]
                        yield number, found
            except BrokenProcessPool:
                lost += 1
                if lost == ATTEMPTS:
                    raise


@dataclass(frozen=True)
class Cluster:
    """The workers of a dask scheduler; what a lost one had in hand is done by another."""

    client: "Client"

    def __call__(self, function: Callable[[Task], Found], tasks: Sequence[Task], /) -> Iterator[tuple[int, Found]]:
        """As Workers. Raises KilledWorker where a task loses its worker again and again."""
        from distributed import as_completed

        waiting = enumerate(tasks)
        numbers: dict[object, int] = {}

        def hand_out() -> "DaskFuture | None":
            number, task = next(waiting, (0, None))
            if task is None:
                return None
            future = self.client.submit(function, task, pure=False)
            numbers[future.key] = number
            return future

        ahead = AHEAD * max(1, sum(self.client.nthreads().values()))
        finished = as_completed([f for f in (hand_out() for _ in range(min(ahead, len(tasks)))) if f is not None])
        try:
            for future in finished:
                number, found = numbers.pop(future.key), future.result()
                if (following := hand_out()) is not None:
                    finished.add(following)
                future.release()
                yield number, found
        finally:
            self.client.cancel([f for f in finished.futures], asynchronous=False)


@contextmanager
def scheduled(address: str | None, workers: int = 0) -> Iterator[Workers]:
    """Where tasks go: threads here; `tcp://host:8786`, a running dask scheduler; `local:2`, processes of its own.

    Raises InputError where dask is not installed, or no scheduler answers.
    """
    if address is None:
        yield Threads(workers)
        return
    kind, _, count = address.partition(":")
    if kind == "local" and not (count.isdecimal() and 0 < int(count) <= 1024):
        raise InputError(f"{address!r}, expected local:N with N processes, or tcp://host:port", "scheduler")
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        raise InputError("needs dask; pip install 'gpmodel[cluster]'", "scheduler") from None
    try:
        if kind == "local":
            place: LocalCluster | str = LocalCluster(n_workers=int(count), threads_per_worker=1, dashboard_address=None)
        else:
            place = address
        client = Client(place, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise InputError(f"no dask scheduler answers at {address} ({error})", "scheduler") from None
    with client:
        try:
            yield Cluster(client)
        finally:
            if not isinstance(place, str):
                place.close()


def _as_finished(
    pool: Executor, function: Callable[[Task], Found], tasks: dict[int, Task], ahead: int
) -> Iterator[tuple[int, Found]]:
    """(number, result) of tasks as they finish, no more than `ahead` of them handed out at a time."""
    waiting = iter(list(tasks.items()))
    running: dict[Future[Found], int] = {}
    finished: SimpleQueue[Future[Found]] = SimpleQueue()

    def hand_out() -> None:
        number, task = next(waiting, (None, None))
        if number is not None:
            future = pool.submit(function, task)  # type: ignore[arg-type]
            running[future] = number
            future.add_done_callback(finished.put)

    try:
        for _ in range(ahead):
            hand_out()
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
