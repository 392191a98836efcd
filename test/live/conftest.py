"""Fixtures of the page's tests: a hub that a test feeds, and a real server of it."""

from __future__ import annotations

import http.client
import importlib.util
import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

if importlib.util.find_spec("rclpy") is None:
    collect_ignore_glob = ["test_live_browser.py"]


@dataclass
class Served:
    """A server with one axis; `results` is the directory whose files it hands out."""

    hub: Any
    port: int
    results: Path

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.port}"

    def ask(self, path: str, method: str = "GET", body: str | None = None, **headers: str) -> tuple[int, dict[str, str], str]:
        """Status, headers and body of one request; header names with _ for -."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.putrequest(method, path, skip_host="host" in named)
        for name, value in named.items():
            connection.putheader(name, value)
        if body is not None:
            connection.putheader("content-length", str(len(body)))
        connection.endheaders(body.encode() if body is not None else None)
        answer = connection.getresponse()
        found = answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read().decode()
        connection.close()
        return found

    def socket(self, axis: str = "azimuth", origin: str | None = "", **more: str) -> Any:
        """A WebSocket as a page opens it; origin: "" for the server's own, None for none. Raises when it is refused."""
        from websockets.sync.client import connect

        own = f"http://{self.host}" if origin == "" else origin
        headers = {name.replace("_", "-"): value for name, value in more.items()}
        return connect(f"ws://{self.host}/live/{axis}", origin=own, additional_headers=headers, open_timeout=10)


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Served]]:
    """`serve(token=..., control=...)`: a real server in a thread of its own; any number of them."""
    from tcs_friction.live.access import Access
    from tcs_friction.live.hub import ROTARY, Hub
    from tcs_friction.live.serving import bound, served

    with ExitStack() as stack:

        def make(**rules: Any) -> Served:
            results = tmp_path / "results"
            results.mkdir(exist_ok=True)
            hub = Hub("azimuth", ROTARY, results)
            listening = bound("127.0.0.1", 0)
            port = listening.getsockname()[1]
            stack.enter_context(served({"azimuth": hub}, Access(**rules), listening))
            return Served(hub, port, results)

        yield make


def next_message(socket: Any, key: str, limit: float = 20.0) -> Any:
    """The next entry of that name that a page is sent; every frame on the way is said to be drawn."""
    deadline = time.monotonic() + limit
    while time.monotonic() < deadline:
        message = json.loads(socket.recv(timeout=limit))
        if "frame" in message:
            socket.send('{"drawn":1}')
        if key in message:
            return message[key]
    raise AssertionError(f"no {key} within {limit} s")
