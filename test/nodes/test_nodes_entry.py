"""The executables, and an interrupt that comes before a node is up."""

from __future__ import annotations

import signal
import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest

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
