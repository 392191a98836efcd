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


def ran(folder: Path, program: str, probe: str) -> subprocess.CompletedProcess[str]:
    """A program that has ended, beside which a module `probe` lies: spawned processes import what they call."""
    (folder / "probe.py").write_text(probe)
    (folder / "program.py").write_text(program)
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path])}
    command = [sys.executable, str(folder / "program.py")]
    return subprocess.run(command, env=variables, capture_output=True, text=True, timeout=60, check=True)


def test_the_first_process_is_deaf_too(tmp_path: Path) -> None:
    """Python's own helper, which is started with it, changes what is blocked."""
    assert ran(tmp_path, FIRST, MASK).stdout == "True\n"


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


FAILING = """
import multiprocessing, probe
from concurrent.futures import ProcessPoolExecutor
from benchmarks.children import begun, ended_with_this
if __name__ == "__main__":
    for _ in range(5):
        try:
            with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool, ended_with_this():
                results, count = begun(pool, probe.work, range(100))
                list(results)
        except ValueError as error:
            print(count, error)
"""
WORK = "import time\n\ndef work(k):\n    time.sleep(0.02)\n    if k == 3:\n        raise ValueError('in a worker')\n"


def test_an_error_in_a_worker_ends_all_of_them_without_words_of_the_pool(tmp_path: Path) -> None:
    done = ran(tmp_path, FAILING, WORK)
    assert done.stdout == 5 * "100 in a worker\n"
    assert done.stderr == ""
