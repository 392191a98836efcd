"""The executables: `tcs_friction.nodes.entry:plant` is what `ros2 run tcs_friction plant` calls, and so for every node.

Kernels and libraries take seconds to load. An interrupt in that time ends the process at once: as the exception that Python
makes of it, it can get lost in a destructor, and the node would run on.
"""

from __future__ import annotations

import functools
import signal
import sys
from collections.abc import Callable, Sequence


def end_at_once() -> None:
    """What an interrupt does until a node has its own way to end."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(name: str, arguments: Sequence[str] | None = None) -> int:
    """Run one node until a signal; `arguments` as on a command line. Raises InputError for a name that is no node's."""
    end_at_once()
    from tcs_friction.nodes.graph import run_node

    return run_node(name, sys.argv[1:] if arguments is None else arguments)


def __getattr__(name: str) -> Callable[[], int]:
    if name.startswith("_"):
        raise AttributeError(name)
    return functools.partial(start, name)
