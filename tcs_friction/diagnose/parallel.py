"""Maps over several cores. Threads serve: what takes time is compiled code that holds no lock."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import TypeVar

In = TypeVar("In")
Out = TypeVar("Out")

MOST_THREADS = 4  # threads: each holds arrays as long as the recordings

_here = threading.local()


def cores() -> int:
    """How many this process may use."""
    if hasattr(os, "sched_getaffinity"):  # not on every system
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def alone() -> Iterator[None]:
    """Within, this thread maps on its own: where one process a core is at work already, more threads only get in their way."""
    before = getattr(_here, "alone", False)
    _here.alone = True
    try:
        yield
    finally:
        _here.alone = before


def side_by_side(function: Callable[[In], Out], items: Iterable[In]) -> list[Out]:
    """`[function(item) for item in items]` on up to MOST_THREADS cores.

    Within another such map, threads that have run out of work there help here.
    """
    items = list(items)
    if getattr(_here, "alone", False):
        return [function(item) for item in items]
    if hasattr(_here, "pool"):
        return _shared(_here.pool, function, items, takes_part=True)
    workers = min(cores(), MOST_THREADS)
    if workers < 2 or len(items) < 2:
        return [function(item) for item in items]
    pool: ThreadPoolExecutor
    with ThreadPoolExecutor(workers, initializer=lambda: setattr(_here, "pool", pool)) as pool:
        return _shared(pool, function, items, takes_part=False)


def _shared(pool: ThreadPoolExecutor, function: Callable[[In], Out], items: list[In], takes_part: bool) -> list[Out]:
    """The map, worked off by whoever in the pool is free, and by this thread if it is one of the pool's.

    Nobody waits for what has not begun, and what has begun waits only for what it began itself: no thread blocks another.
    """
    results: dict[int, Out] = {}
    left = deque(range(len(items)))

    def work() -> None:
        while left:
            try:
                index = left.popleft()
            except IndexError:  # another thread was faster
                return
            try:
                results[index] = function(items[index])
            except BaseException:
                left.clear()
                raise

    offered = [pool.submit(work) for _ in range(min(len(items), MOST_THREADS))]
    if takes_part:
        try:
            work()
        finally:
            offered = [one for one in offered if not one.cancel()]
            wait(offered)
    try:
        for one in offered:
            one.result()
    except BaseException:  # an interrupt: nothing more is begun
        left.clear()
        raise
    return [results[index] for index in range(len(items))]
