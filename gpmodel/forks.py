"""Independent tasks in copies of this process, which have all that it has loaded and read."""

import multiprocessing
import os
import pickle
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import TypeVar

from gpmodel.executor import AHEAD, Found, Task, Threads, cores, lost_replaced

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
"""One task after another."""


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
