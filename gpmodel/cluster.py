"""Independent tasks on other machines, by a dask scheduler."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gpmodel.errors import InputError
from gpmodel.executor import AHEAD, Found, Task, Workers
from gpmodel.forks import Forks

if TYPE_CHECKING:
    from distributed import Client
    from distributed import Future as DaskFuture

PATIENCE = "10s"
"""For which a scheduler may be silent."""


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
    """Where tasks go: copies of this process; `tcp://host:8786`, a running dask scheduler; `local:2`, its processes.

    Raises InputError where dask is not installed, or no scheduler answers.
    """
    if address is None:
        yield Forks(workers)
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
