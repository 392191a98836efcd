"""As a person uses it: a real graph, the real page, a real browser."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks.listening import wait_until

pytest.importorskip("rclpy", reason="no ROS 2; ./tcs test brings it")
ROOT = Path(__file__).resolve().parents[2]
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
MARKUP = "<b onmouseover=alert(1)>"
PATIENCE = 30_000  # ms
REPORT = """<!doctype html><title>r</title><p id=words>made by a test</p><script>
document.getElementById("words").textContent += ", drawn by its script";
fetch("/").then(() => document.body.append("reached the server"), () => 0);
</script>"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Debian's Chromium; without one the tests are skipped, or fail where everything has to be tested."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        reason = f"no browser: none of {', '.join(BROWSERS)} (apt-get install chromium)"
        if os.environ.get("CI"):
            pytest.fail(reason)
        pytest.skip(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        started = play.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        yield started
        started.close()


class Site:
    """The graph and the page as processes, in a directory of their own and on a ROS domain of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, *words: str) -> None:
        with (self.folder / f"{name}.log").open("ab") as log:
            command = [sys.executable, "-P", "-m", "tcs_friction.cli", *words]
            env = os.environ | {"PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"}
            self._processes[name] = subprocess.Popen(
                command, stdout=log, stderr=subprocess.STDOUT, cwd=self.folder, env=env, start_new_session=True
            )

    def has_shared_memory(self, name: str) -> bool:
        """Whether its messages come through shared memory, of which a process that hangs frees nothing."""
        return "/dev/shm/fastrtps" in Path(f"/proc/{self._processes[name].pid}/maps").read_text()

    def signal(self, name: str, number: int) -> None:
        self._processes[name].send_signal(number)

    def kill(self, name: str) -> None:
        os.killpg(self._processes[name].pid, signal.SIGKILL)
        self._processes.pop(name).wait()

    def address(self, name: str = "live") -> str:
        """Where the page is, once its server says so."""
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            text = (self.folder / f"{name}.log").read_text()
            found = re.search(r"http://\S+", text)
            if found:
                return found.group()
            assert self._processes[name].poll() is None, text
            time.sleep(0.1)
        raise AssertionError((self.folder / f"{name}.log").read_text())

    def close(self) -> None:
        for process in self._processes.values():
            process.send_signal(signal.SIGINT)
        for process in self._processes.values():
            try:
                process.wait(15.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture
def site(tmp_path: Path, ros_domain: None) -> Iterator[Site]:  # noqa: ARG001
    made = Site(tmp_path)
    yield made
    made.close()


@pytest.fixture
def page(browser: Any) -> Iterator[Any]:
    """A page whose every error fails the test; what it asks other servers for would be one."""
    context = browser.new_context(viewport={"width": 1200, "height": 900})
    opened, errors = context.new_page(), []
    opened.set_default_timeout(PATIENCE)
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.on("request", lambda request: errors.append(request.url))
    yield opened
    context.close()
    assert [error for error in errors if not error.startswith(("data:", "about:", "http://127.0.0.1:"))] == []


def until(ready: Callable[[], Any], what: Callable[[], str]) -> None:
    """Poll here: what Playwright polls in the page by itself, the page's Content-Security-Policy forbids."""
    assert wait_until(lambda: bool(ready()), PATIENCE / 1000), what()


def wait_for(page: Any, selector: str, pattern: str) -> str:
    """The text of an element once it matches."""

    def text() -> str:
        return str(page.text_content(selector))

    until(lambda: re.search(pattern, text()), lambda: f"{selector}: {text()!r} is not {pattern!r}")
    return text()


def picture(page: Any, plot: str) -> int:
    """How many dots of a plot are drawn in a strong colour: a curve is there or is not."""
    return int(page.evaluate(
        """plot => { const canvas = document.querySelector(`#plot-${plot} canvas`);
        const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height); let count = 0;
        for (let i = 0; i < data.length; i += 4) {
          const [r, g, b, a] = data.slice(i, i + 4); if (a > 200 && Math.max(r, g, b) - Math.min(r, g, b) > 60) count++; }
        return count; }""",
        plot,
    ))  # fmt: skip


def test_who_knows_the_token_logs_in(site: Site, page: Any) -> None:
    token = "a token of this test".replace(" ", "-")
    (site.folder / "token").write_text(token)
    (site.folder / "token").chmod(0o600)
    site.start("live", "live", "--port", "0", "--token-file", "token")
    page.goto(site.address())
    assert page.locator("[role=alert]").count() == 0
    page.fill("input[name=token]", "another-token-than-that")
    page.click("button")
    assert page.text_content("[role=alert]") == "That is not the token."
    page.reload()
    page.fill("input[name=token]", token)
    page.click("button")
    assert "running" in wait_for(page, "#sentence", "its graph")
    page.reload()
    assert "running" in wait_for(page, "#sentence", "its graph")


def test_a_measurement_from_start_to_report_and_a_graph_that_is_lost_and_comes_back(site: Site, page: Any) -> None:
    folder = site.folder / "results" / MARKUP
    folder.mkdir(parents=True)
    (folder / "report.html").write_text(REPORT)
    site.start("live", "live", "--port", "0")
    page.goto(site.address())
    assert "running" in wait_for(page, "#sentence", "its graph")
    site.start("graph", "graph")

    wait_for(page, "#state", "^Well$")
    wait_for(page, "#sentence", r"Tracking error [0-9.e-]+ arcsec rms .*friction is not compensated")
    assert page.text_content("#number-friction_estimate") == "–"
    assert not site.has_shared_memory("live")
    until(lambda: page.locator("#nodes td.state.is-well").count() == 8, lambda: str(page.text_content("#nodes")))
    until(lambda: picture(page, "error") > 100, lambda: "no curve is drawn")
    assert picture(page, "trail") == 0

    page.click("[data-order=measure]")
    friction = wait_for(page, "#number-friction_estimate", "[0-9]")
    until(lambda: page.text_content("#number-friction_estimate") != friction, lambda: f"it stays {friction}")
    wait_for(page, "#switches", "Switch1 observer: on.*Switch3 compensation: off")
    page.wait_for_selector("[data-order=measure][aria-pressed=true]")
    page.locator("#untraced").wait_for(state="hidden")
    until(lambda: picture(page, "trail") > 10, lambda: "no points are drawn")

    page.click("[data-order=compensate]")
    assert "while the axis is tracking" in page.text_content("#confirm")
    page.click("#confirm button[value=no]")
    page.wait_for_selector("[data-order=measure][aria-pressed=true]")
    page.click("[data-order=compensate]")
    page.click("#confirm button[value=yes]")
    wait_for(page, "#switches", "Switch1 observer: off.*Switch3 compensation: on")

    box = page.locator("#plot-error .u-over").bounding_box()
    page.mouse.move(box["x"] + 60, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 160, box["y"] + 60, steps=4)
    page.mouse.up()
    page.wait_for_selector("#live:not([hidden])")
    page.click("#live")
    page.click("[data-window='5']")
    page.wait_for_selector("[data-window='5'][aria-pressed=true]")

    entry = page.locator("#results li", has_text="report.html")
    assert MARKUP in entry.text_content()
    assert page.locator("#results b").count() == 0
    entry.locator("button").click()
    frame = page.frame_locator("#reader-frame")
    frame.locator("#words", has_text="drawn by its script").wait_for()
    assert "reached the server" not in frame.locator("body").inner_text()

    site.kill("graph")
    wait_for(page, "#state", "^(Standing still|Graph lost)$")
    wait_for(page, "#state", "^Graph lost$")
    assert page.text_content("#number-speed") == "–"
    site.start("graph", "graph")
    wait_for(page, "#state", "^Well$")

    site.signal("live", signal.SIGSTOP)  # it hangs, and closes no connection
    wait_for(page, "#state", "^Page lost$")
    site.signal("live", signal.SIGCONT)
    wait_for(page, "#state", "^Well$")
    site.kill("live")
    wait_for(page, "#state", "^Page lost$")


def test_a_job_is_aborted_and_one_that_is_refused_says_why(site: Site, page: Any) -> None:
    site.start("graph", "graph", "--ros-args", "-p", "memory:=30.0")
    site.start("live", "live", "--port", "0")
    page.goto(site.address())
    wait_for(page, "#state", "^Well$")
    page.click("[data-order=commission]")
    page.click("#confirm button[value=no]")
    assert page.locator("#job").is_hidden()
    page.click("[data-order=commission]")
    page.click("#confirm button[value=yes]")
    wait_for(page, "#job", "commission … measuring the axis")
    assert page.locator("[data-order=identify]").is_disabled()
    page.click("[data-order=abort]")
    assert "was cancelled" in wait_for(page, "#job", "commission: failed")
    assert page.locator("[data-order=identify]").is_enabled()
    page.click("[data-order=abort]")
    assert "no job was running" in wait_for(page, "#job", "abort: done")
    site.kill("graph")
    page.click("[data-order=measure]")
    wait_for(page, "#job", "measure: failed.*(not there|no answer)")


def test_it_is_readable_on_a_phone_and_follows_the_readers_theme(site: Site, browser: Any) -> None:
    site.start("live", "live", "--port", "0")
    smallest = "Math.min(...[...document.querySelectorAll('button')].filter(b => b.offsetParent).map(b => b.offsetHeight))"
    for scheme, paper in (("light", "rgb(255, 255, 255)"), ("dark", "rgb(21, 24, 28)")):
        context = browser.new_context(viewport={"width": 400, "height": 800}, color_scheme=scheme, has_touch=True)
        page = context.new_page()
        page.goto(site.address())
        wait_for(page, "#state", "No graph")
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == paper
        assert page.evaluate(smallest) >= 24
        assert page.locator("#live").is_hidden()
        draw_across(page, "#plot-error .u-over")
        page.click("#live")
        page.locator("#live").wait_for(state="hidden")
        context.close()


def draw_across(page: Any, selector: str) -> None:
    """A finger across the middle of an element, as the touch screen reports it."""
    page.locator(selector).scroll_into_view_if_needed()
    box, touch = page.locator(selector).bounding_box(), page.context.new_cdp_session(page)
    places = [{"x": box["x"] + share * box["width"], "y": box["y"] + 0.5 * box["height"]} for share in (0.3, 0.4, 0.6, 0.7)]
    for kind, place in (("touchStart", places[0]), *(("touchMove", place) for place in places[1:])):
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [place]})
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
