"""Real-time scheduling of this process as far as the system permits it: `./tcs graph --realtime`, or the environment.

What is asked for stands in the environment, so that processes started from here, by `ros2 run` or by a launch file have it, too.
Everything is set before ROS begins: the threads of the middleware, which are made then, inherit it.
"""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import sys

from rclpy.node import Node

from tcs_friction.errors import InputError
from tcs_friction.nodes.core.steady import steady_timer

ASKED = "TCS_FRICTION_REALTIME"
"""Environment: "all", or the processor cores to use, such as "2,3"; unset or empty: nothing is asked for."""
ALL = "all"
PRIORITY = 40
"""Of SCHED_FIFO: below the interrupt threads of a real-time kernel (50), which bring the messages."""
COLLECT_EVERY = 1.0  # s
WORTH = 1000
"""Objects since the last collection from which on another is made; ticks leave none behind."""
_MCL_CURRENT, _MCL_FUTURE = 1, 2


def cores_of(text: str) -> set[int]:
    """The processor cores that a text asks for, none for ALL. Raises InputError for those that this process may not use."""
    if text == ALL:
        return set()
    permitted = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
    words = text.split(",")
    cores = {int(word) for word in words if word.strip().isdecimal()}
    if len(cores) < len(words) or not cores <= permitted:
        here = ",".join(map(str, sorted(permitted))) or "none on this system"
        raise InputError("real time: cores", repr(text), f"{ALL}, or some of {here}")
    return cores


def ask(cores: str) -> None:
    """Ask for real time in this process and those that it starts. cores: as in ASKED. Raises InputError as `cores_of` does."""
    cores_of(cores)
    os.environ[ASKED] = cores


def prepare() -> str:
    """Set what is asked for; in one line what was granted and what was refused, "" if nothing is asked for."""
    asked = os.environ.get(ASKED, "")
    if not asked:
        return ""
    granted, refused = [], []
    if cores := cores_of(asked):
        os.sched_setaffinity(0, cores)
        granted.append(f"{'cores' if len(cores) > 1 else 'core'} {asked}")
    for what, objection in ((f"SCHED_FIFO {PRIORITY}", _first_in_first_out()), ("locked memory", _lock_memory())):
        if objection:
            refused.append(f"{what} ({objection})")
        else:
            granted.append(what)
    parts = [f"granted: {', '.join(granted)}"] if granted else []
    parts += [f"refused: {', '.join(refused)}"] if refused else []
    return f"real time {'; '.join(parts)}"


def _first_in_first_out() -> str:
    """Why this thread, and those that it makes, are not scheduled before everything ordinary; "" if they are."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except (OSError, AttributeError) as error:
        return getattr(error, "strerror", None) or "not on this system"
    return ""


def _lock_memory() -> str:
    """Why pages of this process may have to be fetched, "" if they are kept. With a limit a later allocation could fail."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    if sys.platform != "linux":
        return "not on this system"
    if limit != resource.RLIM_INFINITY and os.geteuid() != 0:
        return f"the limit is {limit // 1024} kB"
    library = ctypes.CDLL(None, use_errno=True)
    return os.strerror(ctypes.get_errno()) if library.mlockall(_MCL_CURRENT | _MCL_FUTURE) else ""


def ordinary() -> None:
    """This thread computes for long and must not keep the machine from anything."""
    if os.environ.get(ASKED) and hasattr(os, "sched_setscheduler"):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def keep_memory_tidy(node: Node) -> None:
    """Leave what exists to itself for good, and under real time collect only what has piled up, at most once a second.

    A collection of everything imported would take several control periods. One of what came since takes 0.1 to 0.4 ms.
    """
    gc.collect()
    gc.freeze()
    if os.environ.get(ASKED):
        gc.disable()
        steady_timer(node, COLLECT_EVERY, _collect)


def _collect() -> None:
    if sum(gc.get_count()) > WORTH:
        gc.collect()
