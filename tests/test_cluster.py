"""Test that a dask scheduler without answer, without workers or shut down gives one line within a time limit."""

import socket
import subprocess
import sys
import time

import pytest

from gpmodel import cluster
from gpmodel.errors import InputError, WriteError

pytest.importorskip("distributed")


def test_a_port_that_never_answers_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(InputError, match="no dask scheduler answers at tcp"), cluster.scheduled(address):
            pass


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_without_workers_and_one_that_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    words = ["-m", "distributed.cli.dask_scheduler", "--port", port, "--host", "127.0.0.1", "--no-dashboard"]
    scheduler = subprocess.Popen([sys.executable, *map(str, words)], stderr=subprocess.DEVNULL)
    try:
        monkeypatch.setattr(cluster, "PATIENCE", 30.0)
        with pytest.raises(InputError, match="has no workers; start one, as in dask worker tcp") as caught:
            _patient(monkeypatch, address)
        assert caught.value.argument == "scheduler"
        words = ["-m", "distributed.cli.dask_worker", address, "--nthreads", 1, "--no-nanny", "--no-dashboard"]
        worker = subprocess.Popen([sys.executable, *map(str, words)], stderr=subprocess.DEVNULL)
        try:
            with pytest.raises(WriteError, match="is gone"):
                _killed_at_work(address, scheduler)
        finally:
            worker.kill()
            worker.wait()
    finally:
        scheduler.kill()
        scheduler.wait()


def _killed_at_work(address: str, scheduler: "subprocess.Popen[bytes]") -> None:
    with cluster.scheduled(address) as workers:
        for number, _ in workers(time.sleep, [0.1, 0.1, 0.1, 60.0, 60.0]):
            if number == 0:
                scheduler.kill()


def _patient(monkeypatch: pytest.MonkeyPatch, address: str) -> None:
    """Connect within 30 s, then wait for workers one second."""
    from distributed import Client

    waits = Client.wait_for_workers
    monkeypatch.setattr(Client, "wait_for_workers", lambda self, count, timeout: waits(self, count, timeout=1.0))
    try:
        with cluster.scheduled(address):
            pass
    finally:
        monkeypatch.setattr(Client, "wait_for_workers", waits)
