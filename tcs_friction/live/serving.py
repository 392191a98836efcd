"""The server in a thread of its own: the socket that it is bound to, its limits, its end."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import signal
import socket
import threading
from collections.abc import Iterator, Mapping
from typing import Any

import h11
import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from tcs_friction.errors import InputError
from tcs_friction.live.access import Access
from tcs_friction.live.hub import Hub
from tcs_friction.live.server import application

ENDING = 5.0  # s that the server gets to end
MOST_CONNECTIONS = 64
LARGEST_MESSAGE = 4096  # bytes, of a page
REQUEST_WITHIN = 10.0  # s, from its first byte or the connection's begin to its last byte; a page sends some hundred bytes


class InTime(H11Protocol):
    """A connection that ends where a request is not there in time: half-sent ones would keep all others out (slowloris)."""

    _late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """As of any connection; the time of the first request begins."""
        super().connection_made(transport)
        self._watch()

    def data_received(self, data: bytes) -> None:
        """As of any connection; more bytes of the same request are given no more time."""
        super().data_received(data)
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        """As of any connection."""
        self._forget()
        super().connection_lost(exc)

    def _watch(self) -> None:
        is_web_socket = self.transport.get_protocol() is not self
        if is_web_socket or self.conn.their_state not in (h11.IDLE, h11.SEND_BODY):
            self._forget()
        elif self._late is None:
            self._late = self.loop.call_later(REQUEST_WITHIN, self._end)

    def _forget(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None

    def _end(self) -> None:
        self._late = None
        self.transport.abort()


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
def served(hubs: Mapping[str, Hub], rules: Access, listening: socket.socket) -> Iterator[list[BaseException]]:
    """The server, until the end of the block. What ends it early also ends this process' nodes, and is in the list."""
    settings: dict[str, Any] = {"http": InTime, "log_level": logging.ERROR, "access_log": False, "server_header": False}
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
