"""Where the work is done: processes on this machine, or a Dask scheduler that is there already."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import warnings
from collections.abc import Iterator

import dask
from distributed import Client, LocalCluster
from distributed.comm import get_address_host_port

from tcs_friction.errors import InputError, JobError

LIBRARIES = ("NUMBA", "OMP", "OPENBLAS", "MKL", "BLIS")
ONE_THREAD = {f"{library}_NUM_THREADS": "1" for library in LIBRARIES}
"""Of worker processes only: numba refuses to compile where the first of them changes after its start."""

SETTINGS = {
    "distributed.worker.profile.enabled": False,  # costs 0.4 MB a second of memory
    "distributed.worker.daemon": True,
    "distributed.scheduler.allowed-failures": 2,
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.comm.retry.count": 0,
}
REACHABLE = 10.0  # s within which a scheduler answers, and has a worker
DASHBOARD = "127.0.0.1:8787"
ENDING, IN_A_HURRY = 10.0, 1.0  # s that workers have for an orderly end; the second after an error or an interrupt


@contextlib.contextmanager
def workers_here(count: int) -> Iterator[Client]:
    """`count` processes of one thread each on this machine, gone at the end however it comes."""
    _quiet()
    with dask.config.set(SETTINGS), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # another port where the usual one is taken
        cluster = LocalCluster(
            n_workers=count, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=DASHBOARD,
            env=ONE_THREAD, silence_logs=logging.CRITICAL,
        )  # fmt: skip
        patience = IN_A_HURRY
        try:
            yield Client(cluster, set_as_default=False)
            patience = ENDING
        finally:
            _end(cluster, patience)


@contextlib.contextmanager
def workers_of(address: str) -> Iterator[Client]:
    """The workers of a scheduler. Raises InputError for what is no address, JobError when it does not answer or has no worker."""
    _quiet()
    with dask.config.set({**SETTINGS, "distributed.comm.timeouts.connect": REACHABLE}):
        try:
            get_address_host_port(address)  # a client that gives up half made complains once more when it is collected
            client = Client(address, timeout=REACHABLE, set_as_default=False)
        except ValueError as error:
            raise InputError("--scheduler", f"{address!r} ({error})", "an address such as tcp://host:8786") from None
        except (OSError, TimeoutError) as error:
            found = f"cannot be reached ({' '.join(str(error).split())[:200] or type(error).__name__})"
            raise JobError(address, found, "a Dask scheduler") from None
        try:
            if not client.nthreads():
                with contextlib.suppress(TimeoutError):
                    client.wait_for_workers(1, timeout=REACHABLE)
            if not client.nthreads():
                raise JobError(address, "has no workers", "dask worker processes that are connected to it")
            yield client
        finally:
            with contextlib.suppress(Exception):
                client.close(timeout=ENDING)


def capacity(client: Client) -> int:
    """Threads of all workers together, at least one."""
    return max(1, sum(client.nthreads().values()))


def _quiet() -> None:
    for name in ("distributed", "tornado", "bokeh", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)


def _processes(cluster: LocalCluster) -> list[int]:
    found = []
    for nanny in cluster.workers.values():
        with contextlib.suppress(Exception):
            found.append(int(nanny.process.pid))
    return found


def _end(cluster: LocalCluster, patience: float) -> None:
    numbers = _processes(cluster)
    try:
        with contextlib.suppress(Exception):
            cluster.close(timeout=patience)
    finally:
        _kill_all(numbers)


def _kill_all(numbers: list[int]) -> None:
    for number in numbers:
        with contextlib.suppress(OSError):
            if b"multiprocessing" in _command_line(number):
                os.kill(number, signal.SIGKILL)


def _command_line(number: int) -> bytes:
    with open(f"/proc/{number}/cmdline", "rb") as file:
        return file.read()
