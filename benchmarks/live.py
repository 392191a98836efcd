"""What the page costs: a graph in real time with its five topics at 1 kHz, alone and then with two pages open.

A third page is open that never reads. The pages are WebSockets that take every frame as a browser's page does. Alone and with
pages are measured in turn, so that a busy machine slows both. CPU and memory are those of the page's process.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.listening import Listening, Report, wait_until
from tcs_friction.commands.parser import positive
from tcs_friction.errors import JobError

ARGUMENTS = ("clock:=real_time", "period:=0.001", "switch1:=true", "switch3:=true")
TOPICS = 5
BEGIN_LIMIT = 90.0  # s
WARM_UP = 8.0  # s with pages before anything is measured
SAMPLE = 1.0  # s between two looks at the page's process
TICKS = os.sysconf("SC_CLK_TCK")
PAGE = os.sysconf("SC_PAGE_SIZE")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The benchmark's own options."""
    parser.add_argument("--seconds", type=positive, default=60, help="of each turn, alone and with pages (default %(default)s)")
    parser.add_argument("--turns", type=positive, default=1, help="how often both are measured (default %(default)s)")


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows: ticks, samples that the page heard, cores, memory."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    words = [word for entry in ARGUMENTS for word in ("-p", entry)]
    alone, shown = [], []
    with tempfile.TemporaryDirectory() as folder, _process(Path(folder, "graph"), "graph", "--ros-args", *words), _ears() as ears:
        if not wait_until(lambda: ears.ticks() > 0, BEGIN_LIMIT):
            raise JobError("bench live", f"the graph did not begin within {BEGIN_LIMIT:g} s", "an idle machine")
        for _ in range(arguments.turns):
            alone.append(_measured(ears, arguments.seconds, None))
            with _process(Path(folder, "live"), "live", "--port", "0") as page, _pages(Path(folder, "live")):
                time.sleep(WARM_UP)
                shown.append(_measured(ears, arguments.seconds, page))
    rate, beside = (float(np.mean([turn.rate for turn in turns])) for turns in (shown, alone))
    heard, cores = (float(np.mean([getattr(turn, name) for turn in shown])) for name in ("heard", "cores"))
    growth = float(np.mean([turn.growth for turn in shown]))
    return [
        {"name": "ticks with two pages, beside without", "value": rate, "unit": "1/s", "beside": beside, "ratio": rate / beside},
        {"name": "samples that the page heard, beside all of five topics", "value": heard, "unit": "1/s",
         "beside": TOPICS * rate, "ratio": heard / (TOPICS * rate)},
        {"name": "the page's process", "value": cores, "unit": "cores", "beside": 0.5, "ratio": cores / 0.5},
        {"name": "its memory grows by", "value": growth, "unit": "MB/min", "beside": shown[-1].memory},
    ]  # fmt: skip


@dataclass(frozen=True)
class Turn:
    """Ticks of the controller and samples heard per second, cores used, growth of memory (MB/min), memory at the end (MB)."""

    rate: float
    heard: float = 0.0
    cores: float = 0.0
    growth: float = 0.0
    memory: float = 0.0


@dataclass
class Ears:
    """The newest report of each node."""

    reports: dict[str, Report] = field(default_factory=dict)

    def ticks(self) -> int:
        """Ticks of the controller so far."""
        report = self.reports.get("controller")
        return int(report.values["ticks"]) if report else 0

    def count(self, node: str, key: str) -> tuple[float, float]:
        """A counter of a node, and when it was reported."""
        report = self.reports.get(node)
        return (float(report.values[key]), report.at) if report else (0.0, 0.0)


@contextlib.contextmanager
def _ears() -> Iterator[Ears]:
    listening, ears = Listening("bench_live"), Ears()
    listening.hear_reports(lambda name, report: ears.reports.__setitem__(name, report))
    listening.begin()
    try:
        yield ears
    finally:
        listening.close()


@contextlib.contextmanager
def _process(log: Path, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    with log.open("wb") as file:
        command = [sys.executable, "-P", "-m", "tcs_friction.cli", *words]
        process = subprocess.Popen(command, stderr=file, stdout=file, start_new_session=True)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60.0)


@contextlib.contextmanager
def _pages(log: Path) -> Iterator[None]:
    """Two pages that read, and one that does not."""
    from websockets.sync.client import connect
    from websockets.typing import Origin

    if not wait_until(lambda: "http://" in log.read_text(), BEGIN_LIMIT):
        raise JobError("bench live", f"the page did not begin within {BEGIN_LIMIT:g} s", "an idle machine")
    found = re.search(r"http://(\S+)/", log.read_text())
    assert found is not None
    address, origin = f"ws://{found.group(1)}/live/azimuth", Origin(f"http://{found.group(1)}")
    over = threading.Event()

    def read() -> None:
        with connect(address, origin=origin) as socket:
            while not over.is_set():
                with contextlib.suppress(TimeoutError):
                    socket.recv(timeout=1.0)
                    socket.send('{"drawn":1}')

    threads = [threading.Thread(target=read) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        with connect(address, origin=origin, max_queue=1, ping_interval=None):
            yield
    finally:
        over.set()
        for thread in threads:
            thread.join()


def _measured(ears: Ears, seconds: float, page: subprocess.Popen[bytes] | None) -> Turn:
    """Watch for a while. Raises JobError when the page's process ends."""
    before, heard_before = ears.count("controller", "ticks"), ears.count("live", "messages heard")
    samples: list[tuple[float, float, float]] = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if page is not None:
            samples.append(_usage(page.pid))
        time.sleep(SAMPLE)
    rate = _per_second(before, ears.count("controller", "ticks"))
    if page is None:
        return Turn(rate)
    if page.poll() is not None:
        raise JobError("bench live", "the page's process has ended", "it to go on")
    at, busy, memory = np.array(samples).T
    growth = float(np.polyfit(at, memory, 1)[0]) * 60.0
    cores = (busy[-1] - busy[0]) / (at[-1] - at[0])
    return Turn(rate, _per_second(heard_before, ears.count("live", "messages heard")), cores, growth, float(memory[-1]))


def _per_second(before: tuple[float, float], after: tuple[float, float]) -> float:
    return (after[0] - before[0]) / max(after[1] - before[1], 1e-9)


def _usage(pid: int) -> tuple[float, float, float]:
    """Steady time (s), processor time (s) and resident memory (MB) of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return time.monotonic(), (int(fields[11]) + int(fields[12])) / TICKS, int(fields[21]) * PAGE / 1e6
