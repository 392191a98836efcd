"""Ctrl-C ends a command in one line with status 130, whatever is going on at that moment."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from tcs_friction import cli

PROBE = """
import atexit, ctypes, signal, sys, time, types
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it, a terminal's does not
{before}
from tcs_friction import cli

def wait(*_):
    print("ready", flush=True)
    for _ in range(3000):
        time.sleep(0.01)

class Waits:
    def __del__(self):
        wait()

def run(arguments):
{body}

module = types.ModuleType("tcs_friction.commands.probe")
module.add_arguments, module.run = lambda parser: None, run
sys.modules[module.__name__], cli.COMMANDS["probe"] = module, ""
sys.argv = ["tcs-friction", "probe"]
sys.exit(cli.main())
"""


def interrupted(body: str, before: str = "", times: int = 1) -> tuple[int, str, str]:
    """Status, output and errors of a command that gets SIGINT when it has said `ready`."""
    program = PROBE.format(before=before, body="\n".join(f"    {line}" for line in body.splitlines()))
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "probe.py").write_text(program)
        command = [sys.executable, "-P", "-m", "probe"]  # a module, as ./tcs has it: Python ends scripts in another way
        variables = {**os.environ, "PYTHONPATH": os.pathsep.join([folder, *sys.path])}
        child = subprocess.Popen(command, env=variables, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        for _ in range(times):
            child.send_signal(signal.SIGINT)
            time.sleep(0.05)
        out, err = child.communicate(timeout=20)  # less than what `wait` takes
        return child.returncode, out, err


GOES_ON = "while True:\n    time.sleep(0.01)"
LOST = {
    "in a destructor": "Waits()",
    "in a callback from C": "ctypes.CFUNCTYPE(None)(wait)()",
    "in a callback of the garbage collector": (
        "import gc\ngc.callbacks.append(lambda *_: (gc.callbacks.clear(), wait()))\ngc.collect()"
    ),
    "by a library that drops everything": "try:\n    wait()\nexcept BaseException:\n    pass",
}


@pytest.mark.parametrize("place", LOST)
def test_an_interrupt_that_gets_lost_comes_again(place: str) -> None:
    assert interrupted(f"{LOST[place]}\n{GOES_ON}") == (130, "", "tcs-friction: interrupted\n")


@pytest.mark.parametrize(
    "body",
    [
        "try:\n    wait()\nexcept KeyboardInterrupt:\n    raise RuntimeError('Error calling __set_name__')",
        "exec('wait()')",
    ],
)
def test_what_python_makes_of_an_interrupt_does_not_matter(body: str) -> None:
    """Another exception, as in the making of a class; the end of the process by a signal, after a text that was executed."""
    assert interrupted(body) == (130, "", "tcs-friction: interrupted\n")


def test_what_an_interrupt_leaves_to_tidy_up_is_not_interrupted() -> None:
    tidying = "try:\n    wait()\nfinally:\n    time.sleep(0.5)\n    print('tidy')"
    assert interrupted(tidying) == (130, "tidy\n", "tcs-friction: interrupted\n")
    in_a_handler = "    try:\n        int('x')\n    except ValueError:\n        time.sleep(0.5)\n    print('tidy')"
    assert interrupted(f"try:\n    wait()\nfinally:\n{in_a_handler}") == (130, "tidy\n", "tcs-friction: interrupted\n")


def test_a_second_interrupt_ends_what_the_first_one_waits_for() -> None:
    waiting = "try:\n    wait()\nfinally:\n    time.sleep(60)"
    assert interrupted(waiting, times=2) == (130, "", "tcs-friction: interrupted\n")


def test_an_interrupt_before_the_command_is_there_is_kept_for_it() -> None:
    """As `./tcs` starts it."""
    blocked = "signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})\nprint('ready', flush=True)\ntime.sleep(0.5)"
    assert interrupted("print('not reached')", before=blocked) == (130, "", "tcs-friction: interrupted\n")


def test_an_interrupt_after_the_command_says_nothing() -> None:
    assert interrupted("atexit.register(wait)") == (-signal.SIGINT, "", "")


def test_handlers_are_left_as_they_were(capsys: pytest.CaptureFixture[str]) -> None:
    hook, before = sys.unraisablehook, signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        for handler in (signal.default_int_handler, signal.SIG_IGN):
            signal.signal(signal.SIGINT, handler)
            assert cli.main(["--help"]) == 0
            assert signal.getsignal(signal.SIGINT) is handler
            assert sys.unraisablehook is hook
    finally:
        signal.signal(signal.SIGINT, before)
    assert "usage" in capsys.readouterr().out
