"""Processes of benchmarks: Ctrl-C does not reach them, and they end when their parent is interrupted."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from benchmarks.children import deaf, ended_with_this

FIRST = """
import multiprocessing, probe
from benchmarks.children import deaf
if __name__ == "__main__":
    receive, send = multiprocessing.get_context("spawn").Pipe()
    with deaf():
        child = multiprocessing.get_context("spawn").Process(target=probe.mask, args=(send,))
        child.start()
    print(receive.recv())
"""
MASK = "import signal\n\ndef mask(send):\n    send.send(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))\n"


def test_the_first_process_is_deaf_too(tmp_path: Path) -> None:
    """Python's own helper, which is started with it, changes what is blocked."""
    (tmp_path / "probe.py").write_text(MASK)
    (tmp_path / "first.py").write_text(FIRST)
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    command = [sys.executable, str(tmp_path / "first.py")]
    done = subprocess.run(command, env=variables, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "True\n"


def test_an_interrupted_parent_does_not_wait() -> None:
    begin = time.monotonic()
    child = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60.0,), daemon=True)
    with deaf():
        child.start()
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with pytest.raises(KeyboardInterrupt), ended_with_this():
        raise KeyboardInterrupt
    child.join()
    assert child.exitcode == -signal.SIGKILL
    assert time.monotonic() - begin < 50.0
