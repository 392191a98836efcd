"""The page's process: ROS in the main thread, as of every node, and the server in a thread of its own."""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import uvicorn

from tcs_friction.errors import InputError, JobError
from tcs_friction.live.access import Access
from tcs_friction.live.hub import LINEAR, ROTARY, Hub
from tcs_friction.live.server import application
from tcs_friction.nodes.arguments import made_with
from tcs_friction.nodes.axes import arguments_by_axis
from tcs_friction.nodes.executor import run
from tcs_friction.nodes.files import axis_file
from tcs_friction.nodes.page_feed import PageFeed

ENDING = 5.0  # s that the server gets to end
MOST_CONNECTIONS = 64
LARGEST_MESSAGE = 4096  # bytes, of a page


def serve(axes: Sequence[str], ros_arguments: Sequence[str], rules: Access, port: int, results: Path) -> int:
    """Show axes, by their files, until a signal; the exit status. port: 0 for a free one."""
    by_axis = arguments_by_axis(axes, (), ros_arguments)
    listening = bound(rules.host, port)
    hubs, makers = {}, []
    for name, arguments in zip(axes, by_axis.values(), strict=True):
        axis = axis_file(name).axis
        hub = hubs[axis.name] = Hub(axis.name, ROTARY if axis.kind == "rotary" else LINEAR, results)
        makers.append(functools.partial(made_with, functools.partial(PageFeed, hub), arguments))
    with _served(hubs, rules, listening) as failure:
        address = url(rules.host, listening.getsockname()[1])
        print(f"tcs-friction: {address} shows {', '.join(hubs)}, until Ctrl-C", file=sys.stderr, flush=True)
        status = run(*makers, args=["live", *next(iter(by_axis.values()))])
    if failure:
        raise JobError("page", f"its server ended ({failure[0]})")
    return status


def bound(host: str, port: int) -> socket.socket:
    """A socket that listens. Raises InputError for an address that is not this machine's or a port that is taken."""
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0]
        return socket.create_server(address[:2], family=family, backlog=64)
    except OSError as error:
        expected = "another --port, or the other page ended" if port else "an address of this machine"
        raise InputError(f"{host}:{port}", f"cannot be bound to ({error.strerror or error})", expected) from None


def url(host: str, port: int) -> str:
    """The address to open; of all addresses that a server is bound to, one that works here."""
    shown = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host, f"[{host}]" if ":" in host else host)
    return f"http://{shown}:{port}/"


@contextlib.contextmanager
def _served(hubs: Mapping[str, Hub], rules: Access, listening: socket.socket) -> Iterator[list[BaseException]]:
    """The server, until the end of the block. What ends it early also ends this process' nodes, and is in the list."""
    settings: dict[str, Any] = {"log_level": logging.ERROR, "access_log": False, "server_header": False}
    settings |= {"ws": "websockets-sansio", "ws_max_size": LARGEST_MESSAGE, "ws_per_message_deflate": False}
    settings |= {"limit_concurrency": MOST_CONNECTIONS, "timeout_graceful_shutdown": 1, "proxy_headers": False}
    server = uvicorn.Server(uvicorn.Config(application(hubs, rules), **settings))
    failure: list[BaseException] = []

    def serve_on() -> None:
        try:
            server.run(sockets=[listening])
        except BaseException as error:
            failure.append(error)
            os.kill(os.getpid(), signal.SIGTERM)

    thread = threading.Thread(target=serve_on, name="page", daemon=True)
    thread.start()
    try:
        yield failure
    finally:
        server.should_exit = True
        thread.join(ENDING)
        listening.close()
