"""Maps over several cores. Threads serve: what takes time is compiled code that holds no lock."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

In = TypeVar("In")
Out = TypeVar("Out")

MOST = 4  # threads: each holds arrays as long as the recordings

_here = threading.local()


def side_by_side(function: Callable[[In], Out], items: Iterable[In]) -> list[Out]:
    """`[function(item) for item in items]`, items on up to MOST cores; within another such map one after the other."""
    items = list(items)
    workers = min(len(os.sched_getaffinity(0)), len(items), MOST)
    if workers < 2 or getattr(_here, "inside", False):
        return [function(item) for item in items]
    with ThreadPoolExecutor(workers, initializer=_enter) as pool:
        return list(pool.map(function, items))


def _enter() -> None:
    _here.inside = True
