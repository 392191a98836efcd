"""The page's process: ROS in the main thread, as of every node, and the server in another."""

from __future__ import annotations

import functools
import sys
from collections.abc import Sequence
from pathlib import Path

from tcs_friction.errors import JobError
from tcs_friction.live.access import Access
from tcs_friction.live.hub import Hub, units_of
from tcs_friction.live.serving import bound, served, url
from tcs_friction.nodes.axes import arguments_by_axis
from tcs_friction.nodes.core.arguments import made_with
from tcs_friction.nodes.core.executor import run
from tcs_friction.nodes.core.files import axis_file
from tcs_friction.nodes.page.feed import PageFeed


def serve(axes: Sequence[str], ros_arguments: Sequence[str], rules: Access, port: int, results: Path) -> int:
    """Show axes, by their files, until a signal; the exit status. port: 0 for a free one."""
    by_axis = arguments_by_axis(axes, (), ros_arguments)
    listening = bound(rules.host, port)
    hubs, makers = {}, []
    for name, arguments in zip(axes, by_axis.values(), strict=True):
        axis = axis_file(name).axis
        hub = hubs[axis.name] = Hub(axis.name, units_of(axis), results)
        makers.append(functools.partial(made_with, functools.partial(PageFeed, hub), arguments))
    with served(hubs, rules, listening) as failure:
        address = url(rules.host, listening.getsockname()[1])
        print(f"tcs-friction: {address} shows {', '.join(hubs)}, until Ctrl-C", file=sys.stderr, flush=True)
        status = run(*makers, args=["live", *next(iter(by_axis.values()))])
    if failure:
        raise JobError("page", f"its server ended ({failure[0]})")
    return status
