"""The executables: `tcs_friction.nodes.entry:plant` is what `ros2 run tcs_friction plant` calls, and so for every node.

Kernels and libraries take seconds to load. An interrupt in that time ends the process at once: as the exception that Python
makes of it, it can get lost in a destructor, and the node would run on.
"""

from __future__ import annotations

import functools
import os
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from tcs_friction.compiled_cache import kept, lasts

RANGE, PROFILES = "ROS_AUTOMATIC_DISCOVERY_RANGE", "FASTRTPS_DEFAULT_PROFILES_FILE"
DISCOVERY = (
    RANGE,
    "ROS_LOCALHOST_ONLY",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "FASTDDS_DEFAULT_PROFILES_FILE",
    PROFILES,
    "CYCLONEDDS_URI",
)
"""Variables by which users say who may find their nodes."""


def stay_local() -> None:
    """Nodes are found on this machine only, unless the environment says who may find them."""
    if not any(os.environ.get(name) for name in DISCOVERY):
        os.environ[RANGE] = "LOCALHOST"


def hear_over_udp() -> None:
    """Where nodes are found on this machine only, let what this process hears come over UDP, not through shared memory.

    For a process that nobody is to wait for: one that hangs makes every message into its shared memory dearer for the sender.
    """
    chosen = [name for name in DISCOVERY if os.environ.get(name)]
    fast = os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp").startswith("rmw_fastrtps")
    if fast and chosen == [RANGE] and os.environ[RANGE] == "LOCALHOST":
        from tcs_friction.config import shipped

        os.environ[PROFILES] = str(shipped("loopback_udp.xml", "security"))
        del os.environ[RANGE]


def keep_logs() -> None:
    """Where ROS writes logs: as ever where that can be written, and in a temporary directory where ROS would end the node."""
    home = os.environ.get("ROS_HOME") or os.path.expanduser("~/.ros")
    folder = Path(os.environ.get("ROS_LOG_DIR") or Path(home, "log"))
    with suppress(OSError):  # nothing can be written anywhere: ROS says so
        os.environ["ROS_LOG_DIR"] = str(kept(folder, "logs of ROS", "so that they go with the process"))


def announce_compiling() -> None:
    """Say that the start takes long where nothing is in the cache of compiled kernels yet."""
    cache = os.environ.get("NUMBA_CACHE_DIR")
    if cache and lasts() and not any(Path(cache).rglob("*.nbi")):
        print("tcs-friction: first start of this version: compiling takes up to a minute, once", file=sys.stderr, flush=True)


def end_at_once() -> None:
    """What an interrupt does until a node has its own way to end."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(name: str, arguments: Sequence[str] | None = None) -> int:
    """Run one node until a signal; `arguments` as on a command line. Raises InputError for a name that is no node's."""
    end_at_once()
    keep_logs()
    announce_compiling()
    from tcs_friction.nodes.graph import run_node

    return run_node(name, sys.argv[1:] if arguments is None else arguments)


def __getattr__(name: str) -> Callable[[], int]:
    if name.startswith("_"):
        raise AttributeError(name)
    return functools.partial(start, name)
