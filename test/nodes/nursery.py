"""A process with everything imported that nodes are forked from: a process of its own each, without the start of Python.

Run as a script by `Nursery`; one line of JSON in, one out. It has no threads and no ROS, so that a fork is sound.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class Nursery:
    """Starts command lines of the product as processes of their own."""

    def __init__(self) -> None:
        self._nurse = subprocess.Popen(
            [sys.executable, "-P", __file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"},
        )

    def start(self, words: Sequence[str], log: Path) -> Child:
        """As the command line with these words, in a session of its own; what it says is added to the log."""
        return Child(self, self.ask({"words": list(words), "log": str(log), "environment": dict(os.environ)}))

    def ask(self, order: dict[str, object]) -> int:
        """The nurse's answer: the pid of a new process, or the status of an old one, -1000 while it lives."""
        assert self._nurse.stdin is not None
        assert self._nurse.stdout is not None
        self._nurse.stdin.write(json.dumps(order) + "\n")
        self._nurse.stdin.flush()
        return int(self._nurse.stdout.readline())

    def close(self) -> None:
        """No more children."""
        self._nurse.communicate()


class Child:
    """What the tests use of subprocess.Popen."""

    def __init__(self, nursery: Nursery, pid: int) -> None:
        self.pid = pid
        self._nursery = nursery
        self._status: int | None = None

    def poll(self) -> int | None:
        """Its exit status, None while it lives."""
        if self._status is None:
            status = self._nursery.ask({"of": self.pid})
            self._status = None if status == ALIVE else status
        return self._status

    def wait(self, limit: float = 60.0) -> int:
        """Its exit status. Raises TimeoutExpired when there is none in time (s)."""
        deadline = time.monotonic() + limit
        while (status := self.poll()) is None:
            if time.monotonic() > deadline:
                raise subprocess.TimeoutExpired("node", limit)
            time.sleep(0.01)
        return status

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)


ALIVE = -1000


def _become(order: dict[str, object]) -> None:
    """In the new process: the command line, and its end."""
    os.setsid()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it, a terminal's does not
    log = os.open(str(order["log"]), os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    for number in (1, 2):
        os.dup2(log, number)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.environ.clear()
    os.environ.update(order["environment"])  # type: ignore[call-overload]
    sys.argv = ["tcs-friction", *order["words"]]  # type: ignore[misc]
    from tcs_friction.cli import main

    raise SystemExit(main())


def _nurse() -> None:
    from tcs_friction.nodes.graph import module_of, node_names

    for name in node_names():
        importlib.import_module(module_of(name))
    for line in sys.stdin:
        order = json.loads(line)
        if "of" in order:
            pid, status = os.waitpid(order["of"], os.WNOHANG)
            print(os.waitstatus_to_exitcode(status) if pid else ALIVE, flush=True)
            continue
        pid = os.fork()
        if pid == 0:
            _become(order)
        print(pid, flush=True)


if __name__ == "__main__":
    _nurse()
