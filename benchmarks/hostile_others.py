"""What hurts a program from other sides than its files: plug-ins, requests that do not end, words of a command line."""

from __future__ import annotations

import contextlib
import io
import json
import random
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.hostile_bags import Maker
from tcs_friction.cli import main
from tcs_friction.config import shipped
from tcs_friction.errors import InputError
from tcs_friction.live import serving
from tcs_friction.live.access import Access
from tcs_friction.live.hub import ROTARY, Hub
from tcs_friction.physics import registry

TERMS = (
    "raise ZeroDivisionError('two\\nlines \\x1b[31m')", "import no_such_module", "TERM = 1 / 0", "TERM = 'text'", "TERM = None",
    "import sys; sys.exit(3)", "def f(:", "class T:\n    def __getattr__(self, name):\n        raise OSError\nTERM = T()",
    "from tcs_friction.physics.effects.cogging import TERM", "", "\0", "raise KeyError", "TERM = object()",
)  # fmt: skip
SECRET = "X-Amz-Signature=5e1f"
WORDS = (
    "", "\udcff", "a\nb", "\x1b[31m", "/dev/zero", "/proc/self/mem", f"https://nowhere.invalid/bag.mcap?{SECRET}", "x" * 5000,
    "-1", "nan", "~",
)  # fmt: skip
COMMANDS = (
    ["identify", "?", "--axis", "AXIS", "-o", "?"], ["identify", "AXIS", "--axis", "?", "-o", "OUT"],
    ["identify", "AXIS", "--axis", "AXIS", "--joint", "?", "-o", "OUT"], ["diagnose", "?", "--axis", "AXIS", "-o", "?"],
    ["new", "?", "-o", "?"], ["new", "AXIS", "--name", "?", "-o", "OUT"], ["bag", "info", "?"], ["bag", "import", "?", "-o", "?"],
    ["compensate", "AXIS", "--reference", "?", "-o", "?"],
    ["compensate", "AXIS", "--diagnosis", "?", "--reference", "AXIS", "-o", "OUT"],
    ["simulate", "?", "-o", "?"], ["fleet", "report", "?"], ["?"],
)  # fmt: skip


def plug_in(path: Path, size: int) -> Path:
    """Another package that offers so many terms, each of which cannot be loaded in a way of its own."""
    chance = random.Random(f"plug-in {size}")
    path.mkdir()
    lines: list[str] = []
    for number in range(size):
        name = f"hostile_{path.name}_{size}_{number}"
        (path / f"{name}.py").write_text(chance.choice(TERMS))
        called, attribute = chance.choice(("lugre", "cogging", name)), chance.choice(("TERM", "TERM.x", "nothing", "os.path"))
        lines.append(f"{called} = {name}:{attribute}")
    info = path / f"hostile_{path.name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: hostile_{path.name}\nVersion: 1.0\n")
    half = len(lines) // 2
    groups = zip(registry.GROUPS, (lines[:half], lines[half:]), strict=True)
    offered = ("\n".join([f"[{group}]", *dict.fromkeys(own), ""]) for group, own in groups)
    (info / "entry_points.txt").write_text("".join(offered))
    return path


def request(path: Path, size: int) -> Path:
    """The beginning of a request, of `size` bytes."""
    chance = random.Random(f"request {size}")
    post = "POST /login HTTP/1.1\r\nhost: localhost\r\norigin: http://localhost\r\ncontent-length: 99999\r\n\r\n"
    begin = chance.choice(("GET / HTTP/1.1\r\nhost: localhost\r\n", post, "\r\n", "\0"))
    path.write_bytes((begin + "x: " + "y" * size)[:size].encode())
    return path


def words(path: Path, size: int) -> Path:
    """A command line with odd words."""
    chance = random.Random(f"words {size}")
    known = {"AXIS": str(shipped("azimuth_1p2m.yaml")), "OUT": str(path.with_suffix(".out"))}
    line = [chance.choice(WORDS) if word == "?" else known.get(word, word) for word in chance.choice(COMMANDS)]
    path.write_text(json.dumps(line))
    return path


def reading_plug_in(path: Path) -> list[Callable[[], object]]:
    """What every command does first."""

    def collected() -> None:
        sys.path.insert(0, str(path))
        registry.laws.cache_clear()
        registry.effects.cache_clear()
        try:
            if "lugre" not in registry.laws() or "cogging" not in registry.effects():
                raise AssertionError("own terms are gone")
        finally:
            sys.path.remove(str(path))

    return [collected]


def reading_request(path: Path) -> list[Callable[[], object]]:
    """As many such requests as the server has connections; then somebody asks for the page."""

    def asked() -> None:
        serving.REQUEST_WITHIN = 0.3
        listening = serving.bound("127.0.0.1", 0)
        port = listening.getsockname()[1]
        half = path.read_bytes()
        with serving.served({"axis": Hub("axis", ROTARY, path.parent)}, Access(), listening), contextlib.ExitStack() as stack:
            for _ in range(serving.MOST_CONNECTIONS):
                one = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
                with contextlib.suppress(OSError):
                    one.sendall(half)
            deadline = time.monotonic() + 60.0
            while not _answers(port):
                if time.monotonic() > deadline:
                    raise AssertionError("the page is closed")
                time.sleep(0.1)

    return [asked]


def _answers(port: int) -> bool:
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=5.0) as one:
        one.sendall(b"GET / HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n")
        return one.recv(12) == b"HTTP/1.1 200"
    return False


def reading_words(path: Path) -> list[Callable[[], object]]:
    """The command; it has to refuse, in one printable line without what permits."""

    def run() -> None:
        told = io.StringIO()
        with contextlib.redirect_stderr(told):
            try:
                status = main(json.loads(path.read_text()))
            except SystemExit as end:
                status = int(end.code or 0)
        text = told.getvalue()
        lines = [line for line in text.splitlines() if line.strip()]
        if status == 0 or SECRET in text or (len(lines) != 1 and status != 2) or not all(map(str.isprintable, lines)):
            raise AssertionError(f"status {status}: {text[-500:]!r}")
        raise InputError("command line", "was refused")

    return [run]


PLUG_INS: dict[Maker, tuple[int, int]] = {plug_in: (1, 30)}
REQUESTS: dict[Maker, tuple[int, int]] = {request: (1, 30_000)}
COMMAND_LINES: dict[Maker, tuple[int, int]] = {words: (1, 1_000_000)}
"""Makers, each with the least and the largest size to draw."""
