"""The page's server: a page, its files, results, and a WebSocket for each page that is open.

Everything that comes in is checked in `_Gate` before any of it is looked at.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping
from importlib.resources import files
from typing import Any
from urllib.parse import parse_qs

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import FileResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from tcs_friction.live.access import COOKIE, Access, same_origin
from tcs_friction.live.hub import Hub
from tcs_friction.live.results import contents_of
from tcs_friction.live.stream import PERIOD, Pages, converse
from tcs_friction.report.assets import touch_script, uplot_script, uplot_style

MOST_FORM = 1000  # bytes
WRONG_TOKEN_COSTS = 1.0  # s
PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; frame-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'self'"
)
"""A report has its scripts and styles inside. In its sandbox it has no origin: it reaches neither this server nor another."""
ALWAYS = {
    "x-content-type-options": "nosniff",
    "referrer-policy": "same-origin",  # with none at all a browser hides the origin of the form
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}
SCRIPT, STYLE = "text/javascript; charset=utf-8", "text/css; charset=utf-8"
SANDBOX = {"content-security-policy": REPORT_POLICY}
NOT_FOUND = PlainTextResponse("not found\n", 404)
NO_TOKEN = PlainTextResponse("a token is needed\n", 401)
REFUSAL = "<!-- refusal -->"
OWN_FILES = {"page.js": SCRIPT, "plots.js": SCRIPT, "panels.js": SCRIPT, "page.css": STYLE}


def application(hubs: Mapping[str, Hub], rules: Access) -> ASGIApp:
    """The server for some axes, by name; the first is shown unless another is asked for."""
    answers = _Answers(hubs, rules)
    routes = [
        Route("/", answers.page, methods=["GET"]),
        Route("/login", answers.login, methods=["POST"]),
        Route("/login", answers.to_the_page, methods=["GET"]),
        Route("/page/{name}", answers.own_file, methods=["GET"]),
        Route("/results/{axis}/{path:path}", answers.result, methods=["GET"]),
        Route("/recordings/{axis}/{path:path}", answers.recording, methods=["GET"]),
        WebSocketRoute("/live/{axis:path}", answers.live),
    ]
    return _Gate(Starlette(routes=routes, lifespan=_lifespan(hubs)), rules)


class _Answers:
    """What each address answers."""

    def __init__(self, hubs: Mapping[str, Hub], rules: Access) -> None:
        self._hubs, self._rules = hubs, rules
        self._pages = Pages(hubs, rules.control)
        self._looking = asyncio.Lock()  # through one recording at a time
        self._files = {name: (_page_file(name), kind) for name, kind in OWN_FILES.items()}
        self._files |= {"uPlot.js": (uplot_script(), SCRIPT), "touch.js": (touch_script(), SCRIPT)}
        self._files |= {"uPlot.css": (uplot_style(), STYLE)}
        self._page, self._login = _page_file("index.html"), _page_file("login.html")

    async def page(self, request: Request) -> Response:
        if not self._welcome(request):
            return self._form(401)
        return Response(self._page, media_type="text/html")

    async def login(self, request: Request) -> Response:
        if not same_origin(request.headers.get("origin"), request.headers.get("host")):
            return self._form(403, "The form came from another site, or the browser hides from where. Enter the token here.")
        if not self._rules.accepts(await _token_in(request)):
            await asyncio.sleep(WRONG_TOKEN_COSTS)
            return self._form(401, "That is not the token.")
        answer = RedirectResponse("/", 303)
        answer.set_cookie(COOKIE, self._rules.session, httponly=True, samesite="strict")
        return answer

    async def to_the_page(self, _: Request) -> Response:
        """Of somebody who reloads the form after a refusal."""
        return RedirectResponse("/", 303)

    def _form(self, status: int, refusal: str = "") -> Response:
        told = f'<p role="alert">{refusal}</p>' if refusal else ""
        return Response(self._login.replace(REFUSAL, told), status, media_type="text/html")

    async def own_file(self, request: Request) -> Response:
        content, kind = self._files.get(request.path_params["name"], ("", ""))
        return Response(content, media_type=kind) if kind else NOT_FOUND

    async def result(self, request: Request) -> Response:
        if not self._welcome(request):
            return NO_TOKEN
        hub = self._hubs.get(request.path_params["axis"])
        found = hub.results.file(request.path_params["path"]) if hub else None
        return FileResponse(found[0], media_type=found[1], headers=SANDBOX) if found else NOT_FOUND

    async def recording(self, request: Request) -> Response:
        if not self._welcome(request):
            return NO_TOKEN
        hub = self._hubs.get(request.path_params["axis"])
        path = hub.results.recording(request.path_params["path"]) if hub else None
        if path is None:
            return NOT_FOUND
        async with self._looking:
            return PlainTextResponse(await run_in_threadpool(contents_of, path), headers=SANDBOX)

    async def live(self, socket: WebSocket) -> None:
        same = same_origin(socket.headers.get("origin"), socket.headers.get("host"))
        axis = socket.path_params["axis"] or next(iter(self._hubs))
        if same and self._welcome(socket) and axis in self._hubs:
            await converse(socket, self._pages, axis)
        else:
            await socket.close(1008)

    def _welcome(self, request: HTTPConnection) -> bool:
        return self._rules.welcomes(request.cookies.get(COOKIE), request.headers.get("authorization"))


def _lifespan(hubs: Mapping[str, Hub]) -> Any:
    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        task = asyncio.create_task(_advance(hubs))
        yield
        task.cancel()

    return lifespan


async def _advance(hubs: Mapping[str, Hub]) -> None:
    while True:
        for hub in hubs.values():
            hub.advance()
        await asyncio.sleep(PERIOD)


async def _token_in(request: Request) -> str:
    """The field `token` of a small form, "" for anything else; who has gone in its middle is not there for the answer."""
    body = b""
    with contextlib.suppress(ClientDisconnect):
        async for part in request.stream():
            body += part
            if len(body) > MOST_FORM:
                return ""
    return parse_qs(body.decode("utf-8", "replace")).get("token", [""])[0]


def _page_file(name: str) -> str:
    return (files(__package__) / "page" / name).read_text(encoding="utf-8")


class _Gate:
    """Refuses requests for another host's name, and puts the same headers on every answer."""

    def __init__(self, inner: ASGIApp, rules: Access) -> None:
        self._inner, self._rules = inner, rules

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._inner(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.setdefault("content-security-policy", PAGE_POLICY)
                for name, value in ALWAYS.items():
                    headers[name] = value
            await send(message)

        if self._rules.knows(Headers(scope=scope).get("host")):
            await self._inner(scope, receive, guarded)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse("refused: this is not the host that was asked for\n", 421)(scope, receive, guarded)
