"""Run independent tasks on other computers through a dask scheduler."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from gpmodel.errors import InputError, WriteError
from gpmodel.executor import AHEAD, Forks, Found, Task, Workers

if TYPE_CHECKING:
    from distributed import Client
    from distributed import Future as DaskFuture

PATIENCE = 10.0
"""Seconds that a dask scheduler may take to answer, and then to have a worker."""


@dataclass(frozen=True)
class Cluster:
    """The workers of a dask scheduler. If a worker is lost, another worker repeats its tasks."""

    client: "Client"

    def __call__(self, function: Callable[[Task], Found], tasks: Sequence[Task], /) -> Iterator[tuple[int, Found]]:
        """Yield number and result of each task as it finishes; raise KilledWorker if a task keeps losing its worker."""
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


def _answering(connect: Callable[[], "Client"]) -> "Client":
    """Return the dask client that `connect` makes, waiting at most 20 seconds.

    Raises TimeoutError without an answer: dask sets no limit on the handshake of a client.
    """
    made: list[Client | Exception] = []

    def attempt() -> None:
        try:
            made.append(connect())
        except (OSError, ValueError) as error:
            made.append(error)

    waiting = threading.Thread(target=attempt, daemon=True)
    waiting.start()
    waiting.join(2 * PATIENCE)
    if not made:
        raise TimeoutError(f"silent for {2 * PATIENCE:g} s")
    if isinstance(made[0], Exception):
        raise made[0]
    return made[0]


@contextmanager
def scheduled(address: str | None, workers: int = 0) -> Iterator[Workers]:
    """Yield the workers (processes) that an address names.

    The address None names copies of this process. `tcp://host:8786`: a running dask scheduler. `local:2`: two new dask
    processes. Raises InputError if dask is not installed or no scheduler answers.
    """
    if address is None:
        yield Forks(workers)
        return
    kind, _, count = address.partition(":")
    if not (count.isdecimal() and 0 < int(count) <= 1024 if kind == "local" else count):
        raise InputError(f"{address!r}, expected local:N with N processes, or tcp://host:port", "scheduler")
    try:
        from distributed import CancelledError, Client, LocalCluster
        from distributed.comm.core import CommClosedError
    except ImportError:
        raise InputError("needs dask; pip install 'gpmodel[cluster]'", "scheduler") from None
    try:
        if kind == "local":
            place: LocalCluster | str = LocalCluster(n_workers=int(count), threads_per_worker=1, dashboard_address=None)
        else:
            place = address
        client = _answering(partial(Client, place, timeout=f"{PATIENCE:g}s"))
    except (OSError, ValueError) as error:
        raise InputError(f"no dask scheduler answers at {address} ({error})", "scheduler") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            message = f"the dask scheduler at {address} has no workers; start one, as in dask worker {address}"
            raise InputError(message, "scheduler") from None
        try:
            yield Cluster(client)
        except (CancelledError, CommClosedError) as error:
            raise WriteError(
                f"--scheduler: the dask scheduler at {address} is gone ({error}); start it again"
            ) from None
        finally:
            if not isinstance(place, str):
                place.close()
