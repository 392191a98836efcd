"""The talk with one page: frames go out 20 times a second, and no faster than the page says that it has drawn them.

A page that does not read, is hidden or is on a slow line gets fewer frames. Nothing is kept for it: each frame is made when it
can go, of what the page lacks by then.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import time
from collections.abc import Mapping
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from tcs_friction.live.hub import Cursor, Hub, changes
from tcs_friction.live.traces import WINDOWS
from tcs_friction.nodes.page.state import CANCEL, LEAVE_OUT, ORDERS

PERIOD = 0.05  # s between two frames
STATUS_EVERY = 0.25  # s
MOST_PAGES = 16
AHEAD = 2
"""Frames that a page may be behind."""
CONTRARY, FULL = 1008, 1013
"""Codes with which a WebSocket is closed."""


class Pages:
    """The pages that are open, and what all of them get."""

    def __init__(self, hubs: Mapping[str, Hub], control: bool) -> None:
        self.hubs = hubs
        self.control = control
        self.open = 0
        self._status: dict[str, tuple[float, dict[str, Any]]] = {}

    def status(self, axis: str) -> dict[str, Any]:
        """An axis' status, made at most every STATUS_EVERY seconds."""
        now = time.monotonic()
        made, status = self._status.get(axis, (-math.inf, {}))
        if now - made >= STATUS_EVERY:
            status = self.hubs[axis].status(self.control)
            self._status[axis] = (now, status)
        return status


class Page:
    """What one page asked for and how far it is."""

    def __init__(self) -> None:
        self.cursor = Cursor()
        self.window = self.cursor.window
        self.zoom: tuple[float, float] | None = None
        self.ahead = 0
        self.told = ""
        """An answer to an order that was not taken."""

    def take(self, text: str, hub: Hub, control: bool) -> None:
        """One message of the page. Raises ValueError for what no page of ours sends."""
        message = json.loads(text)
        if not isinstance(message, dict) or len(message) != 1:
            raise ValueError("one entry expected")
        name, value = next(iter(message.items()))
        if name == "drawn":
            self.ahead = max(0, self.ahead - 1)
        elif name == "window" and value in WINDOWS:
            self.window = int(value)
        elif name == "zoom" and _is_range(value):
            self.zoom = (float(value[0]), float(value[1]))
        elif name == "order" and value in ORDERS:
            self._order(value, hub, control)
        elif name == "effect" and _is_switch(value) and hub.can_cancel(value[0]):
            self._order(f"{CANCEL if value[1] else LEAVE_OUT}{value[0]}", hub, control)
        else:
            raise ValueError(f"not expected: {name}"[:80])

    def _order(self, order: str, hub: Hub, control: bool) -> None:
        self.told = "" if control else "This page may only look: the server runs without --control."
        if control:
            hub.order(order)

    def answer(self, hub: Hub, status: Mapping[str, Any]) -> dict[str, Any]:
        """What the page lacks now."""
        found: dict[str, Any] = {"frame": hub.frame(self.cursor, self.window)}
        new = changes(self.cursor.status, status)
        if new:
            found["status"] = new
            self.cursor.status = dict(status)
        if self.zoom is not None:
            found["zoom"] = hub.zoomed(self.window, *self.zoom)
            self.zoom = None
        if self.told:
            found["told"], self.told = self.told, ""
        return found


async def converse(socket: WebSocket, pages: Pages, axis: str) -> None:
    """Serve one page until it goes."""
    await socket.accept()
    if pages.open >= MOST_PAGES:
        await socket.close(FULL, f"{MOST_PAGES} pages are open already")
        return
    pages.open += 1
    page, hub = Page(), pages.hubs[axis]
    sending = asyncio.create_task(_send(socket, page, pages, axis))
    try:
        while True:
            page.take(await socket.receive_text(), hub, pages.control)
    except (ValueError, KeyError, TypeError, RecursionError):
        with contextlib.suppress(RuntimeError):
            await socket.close(CONTRARY)
    except WebSocketDisconnect:
        pass
    finally:
        pages.open -= 1
        sending.cancel()
        with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
            await sending


async def _send(socket: WebSocket, page: Page, pages: Pages, axis: str) -> None:
    hub = pages.hubs[axis]
    await socket.send_text(_json({"hello": {**hub.hello(), "axes": list(pages.hubs)}}))
    while True:
        if page.ahead < AHEAD:
            page.ahead += 1
            await socket.send_text(_json(page.answer(hub, pages.status(axis))))
        await asyncio.sleep(PERIOD)


def _is_range(value: Any) -> bool:
    """Two times, in s of the run."""
    if not (isinstance(value, list) and len(value) == 2 and all(type(number) in (int, float) for number in value)):
        return False
    return -1e10 < value[0] < value[1] < 1e10


def _is_switch(value: Any) -> bool:
    """A name, and on or off."""
    return isinstance(value, list) and [type(entry) for entry in value] == [str, bool]


def _json(content: Any) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False)
