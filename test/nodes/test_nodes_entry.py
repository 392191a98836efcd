"""The executables, and an interrupt that comes before a node is up."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

import tcs_friction
from tcs_friction.compiled_cache import fingerprint
from tcs_friction.nodes.graph import node_names

LOST = """
import sys
from importlib.abc import MetaPathFinder

class Trap(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "tcs_friction.nodes.graph":
            Swallows()

class Swallows:
    def __del__(self):
        import os, signal
        os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Trap())
from tcs_friction.nodes.entry import plant
plant()
"""


@pytest.mark.parametrize("name", node_names())
def test_every_executable_is_found(name: str) -> None:
    assert callable(EntryPoint(name, f"tcs_friction.nodes.entry:{name}", "console_scripts").load())


def test_an_interrupt_in_a_destructor_while_loading_is_not_lost() -> None:
    ended = subprocess.run([sys.executable, "-c", LOST], capture_output=True, text=True, timeout=30, check=False)
    assert ended.returncode == -signal.SIGINT
    assert ended.stderr == ""


FIRST = "tcs-friction: first start of this version: compiling takes up to a minute, once"


@pytest.mark.parametrize(("home", "words"), [("file", "cannot be kept"), ("new", FIRST), ("used", ""), (None, "")])
def test_a_node_says_in_one_line_what_is_odd_about_its_home(home: str | None, words: str, tmp_path: Path) -> None:
    """Where there is none, ROS itself would end the node, since it finds no place for logs."""
    (tmp_path / "file").touch()
    compiled = tmp_path / "used/.cache/tcs_friction" / fingerprint(Path(tcs_friction.__file__).parent)
    compiled.mkdir(parents=True)
    (compiled / "kernel.nbi").touch()
    names = ("HOME", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "ROS_LOG_DIR", "ROS_HOME")
    variables = {name: value for name, value in os.environ.items() if name not in names}
    variables["NUMBA_DISABLE_JIT"] = "1"  # without a cache it would compile for a minute
    if home is not None:
        variables["HOME"] = str(tmp_path / home)
    command = [sys.executable, "-P", "-m", "tcs_friction.cli", "node", "player"]
    ended = subprocess.run(command, env=variables, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 2, ended.stderr
    *others, last = ended.stderr.splitlines()
    assert "bag" in last
    assert len(others) == bool(words), ended.stderr
    assert all(words in line for line in others)
