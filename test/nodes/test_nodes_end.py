"""A node that ends takes with it what it made, in whatever order the garbage collector comes to the rest."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from conftest import ROOT

MADE_AND_ENDED = """
import gc
import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.clock import ROSClock
from tcs_friction.nodes.core.executor import close, make_executor
from tcs_friction.nodes.graph import factory

for name in ("identifier", "commission"):
    rclpy.init(args=["test"])
    executor, node = make_executor(), factory(name)()
    executor.add_node(node)
    actions = [one for one in node.waitables if isinstance(one, (ActionClient, ActionServer))]
    close(executor, [node])
    vars(node).clear()  # as a collector does that comes to the node, and with it to its clock, before its actions
    del executor, node
    gc.collect()
    others = [ROSClock() for _ in range(100)]  # where that clock was
    print(name, len(actions))
    actions.clear()
    gc.collect()
"""


def test_actions_end_with_their_node_and_not_after_its_clock(tmp_path: Path) -> None:
    """Else rcl takes from the clock's memory, freed by then, the callback that it put there: a crash, or this line in the log."""
    env = os.environ | {"PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}"}
    command = [sys.executable, "-X", "faulthandler", "-c", MADE_AND_ENDED]
    done = subprocess.run(command, env=env, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "identifier 1\ncommission 3\n"), done.stderr
    assert "jump callback" not in done.stderr
