"""A real server over real HTTP and WebSocket: what it answers, and what it refuses."""

from __future__ import annotations

import asyncio
import json
import math
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest
from page_server import Served, next_message
from starlette.requests import Request
from websockets.exceptions import ConnectionClosed, InvalidStatus

from tcs_friction.errors import InputError
from tcs_friction.live import serving, stream
from tcs_friction.live.access import Access
from tcs_friction.live.hub import ROTARY, Hub
from tcs_friction.live.server import _token_in
from tcs_friction.live.serving import bound, served, url
from tcs_friction.nodes.page.state import Condition, Effect, Job, Switches

TOKEN = "correct-horse-battery-staple"
MARKUP = "<img src=x onerror=alert(1)>"
MS = 1_000_000


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Served]]:
    """`serve(token=..., control=...)`: a real server in a thread of its own; any number of them."""
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


def feed(hub: Any, begin: int, end: int) -> None:
    write = {topic: channel.history.append for topic, channel in hub.traces.channels.items()}
    for k in range(begin, end):
        write["joint_states"](k * MS, 1.0, 0.5, 3.0)
        write["reference"](k * MS, 1.0 + 1e-6, 0.5, 0.0)
        write["friction_estimate"](k * MS, math.nan, 0.5)


def test_the_page_and_all_that_it_loads_come_from_the_server_itself(serve: Callable[..., Any]) -> None:
    server = serve()
    status, headers, page = server.ask("/")
    assert status == 200
    assert "default-src 'none'" in headers["content-security-policy"]
    assert "unsafe" not in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    for name in ("page.js", "plots.js", "panels.js", "page.css", "uPlot.js", "uPlot.css", "touch.js"):
        status, headers, text = server.ask(f"/page/{name}")
        assert status == 200, name
        assert "http://" not in text.replace("http://www.w3.org", ""), name
        page += text
    assert "innerHTML" not in page.replace(server.ask("/page/uPlot.js")[2], "")
    for name in ("server.py", "..%2fserver.py", "login.html", ""):
        assert server.ask(f"/page/{name}")[0] == 404


def test_a_page_is_sent_curves_and_status(serve: Callable[..., Any]) -> None:
    server = serve()
    feed(server.hub, 0, 300)
    server.hub.report("dob", Condition(time.monotonic(), 1, MARKUP, {"rate [1/s]": "999.0", "age of joint_states [s]": "0.002"}))
    server.hub.switched(Switches((True, None, False), "model.yaml", (Effect("cogging", "cancelled"),)))
    server.hub.told(Job("identify", "searching", 0.5, None))
    with server.socket() as page:
        hello = next_message(page, "hello")
        assert (hello["axis"], hello["units"]["error"], hello["axes"]) == ("azimuth", "arcsec", ["azimuth"])
        status = next_message(page, "status")
        assert status["nodes"][0]["message"] == MARKUP  # as it is: the page puts it in as text
        assert (status["nodes"][0]["values"][0], status["nodes"][0]["inputs"]) == ("999.0", 0.002)
        assert status["switches"] == [True, None, False]
        assert status["job"]["running"] is True
        assert status["control"] is True
        frame = next_message(page, "frame")
        while "error" not in frame["bins"]:
            frame = next_message(page, "frame")
        assert max(frame["bins"]["error"]["hi"]) == pytest.approx(1e-6 * 648000 / math.pi)
        feed(server.hub, 300, 700)
        while max(next_message(page, "frame")["bins"].get("speed", {"k": [0]})["k"]) < 699 // 40:
            pass


def test_numbers_that_are_none_do_not_stop_what_is_sent(serve: Callable[..., Any]) -> None:
    """JSON has no word for them, and anybody may publish reports."""
    server = serve()
    ages = {"age of a [s]": "nan", "age of b [s]": "inf", "age of c [s]": "never came"}
    server.hub.report("dob", Condition(time.monotonic(), 0, "", ages))
    server.hub.report("plant", Condition(time.monotonic(), 0, "", {**ages, "age of d [s]": "0.5"}))
    server.hub.told(Job("identify", "searching", math.nan, None))
    with server.socket() as page:
        status = next_message(page, "status")
        assert [node["inputs"] for node in status["nodes"]] == [None, 0.5]
        assert status["job"]["progress"] is None


def test_only_what_is_new_is_sent_and_all_of_it_for_another_window(serve: Callable[..., Any]) -> None:
    server = serve()
    feed(server.hub, 0, 10_000)
    while server.hub.traces.now < 9_999 * MS:
        time.sleep(0.01)
    with server.socket() as page:
        assert len(next_message(page, "frame")["bins"]["speed"]["k"]) == 250
        assert len(next_message(page, "frame")["bins"]["speed"]["k"]) == 1
        page.send('{"window":5}')
        frame = next_message(page, "frame")
        while frame["window"] != 5:
            frame = next_message(page, "frame")
        assert frame["clear"]
        assert len(frame["bins"]["speed"]["k"]) == 500
        page.send('{"zoom":[9.0,9.01]}')
        zoom = next_message(page, "zoom")
        assert len(zoom["curves"]["speed"]["t"]) == 11  # every sample
        assert zoom["curves"]["friction_estimate"]["lo"] == [None] * 11


def test_a_page_that_does_not_draw_is_not_sent_more(serve: Callable[..., Any]) -> None:
    server = serve()
    with server.socket() as page:
        json.loads(page.recv(timeout=10))
        for _ in range(stream.AHEAD):
            page.recv(timeout=10)
        with pytest.raises(TimeoutError):
            page.recv(timeout=0.5)
        page.send('{"drawn":1}')
        assert "frame" in json.loads(page.recv(timeout=10))


def ended(page: Any) -> bool:
    """Whether the server has ended the talk; what it sent before is of no interest."""
    with suppress(ConnectionClosed):
        for _ in range(100):
            page.recv(timeout=10)
        return False
    return True


@pytest.mark.parametrize(
    "message",
    ["", "no json", "[]", "{}", "1", '{"order":"rm"}', '{"order":["measure"]}', '{"window":1e9}', '{"window":[5]}',
     '{"zoom":[2,1]}', '{"zoom":[0,1e999]}', '{"zoom":["a","b"]}', '{"zoom":[true,false]}', '{"drawn":1,"window":5}',
     '{"x":1}', '{"effect":["cogging",true]}', '{"effect":["cogging",1]}', '{"effect":"cogging"}', "[" * 3000],
)  # fmt: skip
def test_a_message_that_no_page_sends_ends_the_talk_and_nothing_else(serve: Callable[..., Any], message: str) -> None:
    server = serve()
    with server.socket() as page:
        page.send(message)
        assert ended(page)
    assert server.hub.next_order() == ""
    assert server.ask("/")[0] == 200


def test_a_message_of_a_size_that_no_page_sends_ends_the_talk(serve: Callable[..., Any]) -> None:
    with serve().socket() as page:
        page.send("x" * 100_000)
        assert ended(page)


def test_orders_reach_the_node_and_are_refused_to_who_may_only_look(serve: Callable[..., Any]) -> None:
    for control in (True, False):
        server = serve(control=control)
        with server.socket() as page:
            assert next_message(page, "status")["control"] is control
            page.send('{"order":"measure"}')
            if control:
                next_message(page, "frame"), next_message(page, "frame"), next_message(page, "frame")
            else:
                assert "may only look" in next_message(page, "told")
            assert server.hub.next_order() == ("measure" if control else "")


def test_an_effect_is_switched_only_where_the_model_has_it(serve: Callable[..., Any]) -> None:
    for control, word, order in ((True, "false", "leave out cogging"), (True, "true", "cancel cogging"), (False, "false", "")):
        server = serve(control=control)
        server.hub.switched(Switches((True,) * 3, "", (Effect("cogging", "cancelled", True), Effect("drag", "not cancelled"))))
        with server.socket() as page:
            page.send(f'{{"effect":["cogging",{word}]}}')
            for _ in range(3):
                next_message(page, "frame")
            assert server.hub.next_order() == order
            page.send(f'{{"effect":["drag",{word}]}}')
            assert ended(page)
        assert server.hub.next_order() == ""


@pytest.mark.parametrize("origin", [None, "null", "http://evil.example", "http://127.0.0.1:1", "https://localhost"])
def test_another_sites_page_gets_no_socket(serve: Callable[..., Any], origin: str | None) -> None:
    with pytest.raises(InvalidStatus) as refused, serve().socket(origin=origin):
        pass
    assert refused.value.response.status_code == 403


def test_a_name_that_is_not_this_machines_gets_nothing(serve: Callable[..., Any]) -> None:
    """As after DNS rebinding: the browser believes that it talks to evil.example."""
    server = serve()
    for path in ("/", "/page/page.js", "/results/azimuth/x.html"):
        status, headers, text = server.ask(path, host="evil.example")
        assert status == 421, path
        assert "tcs_friction" not in text
        assert "content-security-policy" in headers
    with pytest.raises(InvalidStatus), server.socket(origin="http://evil.example", host="evil.example"):
        pass


def test_no_axis_of_that_name_has_no_socket(serve: Callable[..., Any]) -> None:
    with pytest.raises(InvalidStatus), serve().socket(axis="altitude"):
        pass


def test_with_a_token_nothing_is_shown_without_it(serve: Callable[..., Any]) -> None:
    server = serve(token=TOKEN)
    (server.results / "report.html").write_text("secret")
    own = {"origin": f"http://{server.host}"}
    status, _, page = server.ask("/")
    assert (status, "password" in page) == (401, True)
    assert server.ask("/results/azimuth/report.html")[0] == 401
    assert server.ask("/recordings/azimuth/bag")[0] == 401
    with pytest.raises(InvalidStatus), server.socket():
        pass
    for body in ("token=wrong", "", "token=" + "x" * 5000):
        status, _, page = server.ask("/login", "POST", body, **own)
        assert (status, "That is not the token." in page, "password" in page) == (401, True, True)
    for origin in ({"origin": "http://evil.example"}, {"origin": "null"}, {}):
        status, headers, page = server.ask("/login", "POST", f"token={TOKEN}", **origin)
        assert (status, "set-cookie" in headers, "password" in page) == (403, False, True)
    assert server.ask("/login")[0] == 303
    status, headers, _ = server.ask("/login", "POST", f"token={TOKEN}", **own)
    assert status == 303
    assert all(word in headers["set-cookie"] for word in ("HttpOnly", "SameSite=strict"))
    assert TOKEN not in headers["set-cookie"]
    cookie = headers["set-cookie"].partition(";")[0]
    assert server.ask("/", cookie=cookie)[0] == 200
    assert server.ask("/results/azimuth/report.html", authorization=f"Bearer {TOKEN}")[2] == "secret"
    with server.socket(cookie=cookie) as page:
        assert next_message(page, "hello")["axis"] == "azimuth"


def test_reports_are_locked_up_and_paths_stay_below(serve: Callable[..., Any], tmp_path: Any) -> None:
    server = serve()
    (tmp_path / "secret.html").write_text("secret")
    name = f"{MARKUP.replace('/', '')}.html"
    (server.results / name).write_text("<script>1</script>")
    with server.socket() as page:
        assert next_message(page, "status")["results"][0]["path"] == name
    status, headers, _ = server.ask("/results/azimuth/%3Cimg%20src=x%20onerror=alert(1)%3E.html")
    assert status == 200
    policy = headers["content-security-policy"]
    assert policy.startswith("sandbox allow-scripts; default-src 'none'")
    assert "connect-src" not in policy
    assert "allow-same-origin" not in policy
    below = ("../secret.html", "%2e%2e/secret.html", "..%2fsecret.html", "%2e%2e%2fsecret.html", "x/../../secret.html", "%00")
    for path in below:
        assert server.ask(f"/results/azimuth/{path}")[0] == 404, path
    assert server.ask("/results/altitude/x.html")[0] == 404
    assert server.ask("/recordings/azimuth/nothing")[0] == 404


def test_a_recording_is_looked_into(serve: Callable[..., Any]) -> None:
    server = serve()
    (server.results / "bag").mkdir()
    (server.results / "bag/metadata.yaml").write_text("rosbag2_bagfile_information: 1")
    status, headers, text = server.ask("/recordings/azimuth/bag")
    assert status == 200
    assert headers["content-type"].startswith("text/plain")
    assert "sandbox" in headers["content-security-policy"]
    assert "metadata.yaml" in text


def test_no_more_pages_than_can_be_served(serve: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "MOST_PAGES", 1)
    server = serve()
    with server.socket() as first:
        next_message(first, "hello")
        with server.socket() as second, pytest.raises(ConnectionClosed, match="1 pages are open"):
            second.recv(timeout=10)
    with server.socket() as third:  # the first has gone
        assert next_message(third, "hello", 10.0)


FORM = b"POST /login HTTP/1.1\r\nhost: localhost\r\norigin: http://localhost\r\ncontent-length: 9\r\n\r\nto"


@pytest.mark.parametrize("half", [b"", b"GET / HTTP/1.1\r\nhost: ", FORM], ids=["nothing", "headers", "form"])
def test_half_sent_requests_keep_nobody_out(serve: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, half: bytes) -> None:
    monkeypatch.setattr(serving, "REQUEST_WITHIN", 0.5)
    server = serve()
    with server.socket() as page, ExitStack() as stack:
        for _ in range(serving.MOST_CONNECTIONS):
            stack.enter_context(socket.create_connection(("127.0.0.1", server.port))).sendall(half)
        deadline = time.monotonic() + 20.0
        while server.ask("/")[0] != 200 and time.monotonic() < deadline:
            time.sleep(0.1)
        assert server.ask("/")[0] == 200
        next_message(page, "frame")  # a page that is open stays so


def test_who_goes_in_the_middle_of_a_form_has_said_no_token() -> None:
    parts = iter([{"type": "http.request", "body": b"to", "more_body": True}, {"type": "http.disconnect"}])

    async def receive() -> Any:
        return next(parts)

    assert asyncio.run(_token_in(Request({"type": "http", "headers": []}, receive))) == ""


def test_a_request_that_comes_in_two_parts_is_answered(serve: Callable[..., Any]) -> None:
    with socket.create_connection(("127.0.0.1", serve().port), timeout=10.0) as connection:
        connection.sendall(b"GET / HTTP/1.1\r\n")
        time.sleep(0.1)
        connection.sendall(b"host: localhost\r\n\r\n")
        assert connection.recv(100).startswith(b"HTTP/1.1 200")


def test_an_address_that_is_taken_is_refused_in_one_line() -> None:
    taken = bound("127.0.0.1", 0)
    try:
        with pytest.raises(InputError, match="another --port"):
            bound("127.0.0.1", taken.getsockname()[1])
    finally:
        taken.close()
    with pytest.raises(InputError, match="an address of this machine"):
        bound("203.0.113.7", 0)
    assert url("0.0.0.0", 80) == "http://127.0.0.1:80/"
    assert url("::1", 80) == "http://[::1]:80/"
