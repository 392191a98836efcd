"""Processes that a benchmark starts: Ctrl-C is their parent's business."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any


@contextmanager
def deaf() -> Iterator[None]:
    """Processes that are started within do not hear SIGINT, which a terminal sends to them too."""
    resource_tracker.ensure_running()  # it is started with the first process otherwise, and unblocks SIGINT then
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def ended_with_this() -> Iterator[None]:
    """What ends this part of the parent early ends its children, so that nobody waits for them."""
    try:
        yield
    except BaseException:
        for child in multiprocessing.active_children():
            child.kill()
        raise


def begun(pool: ProcessPoolExecutor, work: Callable[[Any], Any], tasks: Sequence[Any]) -> tuple[Iterator[Any], int]:
    """The results to come, and how many.

    Nothing is cancelled, as `pool.map` would: of a killed worker's cancelled tasks the pool prints a traceback.
    """
    with deaf():
        futures = [pool.submit(work, task) for task in tasks]
    return (future.result() for future in futures), len(tasks)
