"""A real server of the page, as its tests ask it."""

from __future__ import annotations

import http.client
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any


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
