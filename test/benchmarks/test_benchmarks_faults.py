"""The benchmark of faults, short, with all its checks; garbled messages are garbled."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.faulty_nodes import Loop, garbled
from benchmarks.listening import wait_until
from tcs_friction.nodes.wire import JointWire


@pytest.mark.usefixtures("ros_domain")
def test_the_loop_keeps_its_limits_and_resumes_after_faults() -> None:
    command = [
        sys.executable,
        "-P",
        "-m",
        "tcs_friction.cli",
        "bench",
        "faults",
        "--minutes",
        "0.2",
        "--json",
    ]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=250, check=False)
    assert ended.returncode == 0, ended.stderr
    results = {entry["name"]: entry for entry in json.loads(ended.stdout)["results"]}
    assert sum(entry["value"] for name, entry in results.items() if name.startswith("faults")) >= 2
    for name in ("largest true speed, beside its limit", "largest torque, beside its limit"):
        assert 0.0 < results[name]["value"] <= results[name]["beside"]
    assert results["inputs refused"]["value"] > 0


@pytest.mark.usefixtures("ros_domain")
def test_a_node_that_ends_by_itself_is_named_with_its_last_words() -> None:
    loop = Loop(0)
    try:
        loop.start("dob")
        assert wait_until(lambda: loop._words("dob").exists(), 100.0)
        assert loop.revive() == []
        loop.signal("dob", signal.SIGSEGV)
        assert wait_until(lambda: loop._processes["dob"].exitcode is not None)
        (said,) = loop.revive()
        assert said.startswith("node dob was killed by SIGSEGV by itself; its last words are in ")
        words = Path(said.rpartition(" ")[2])
        assert "Segmentation fault" in words.read_text()
        assert wait_until(loop._words("dob").exists, 100.0), "it was started anew"
    finally:
        loop.end()
    assert words.exists()
    for path in (*words.parent.iterdir(), words.parent):
        path.unlink() if path.is_file() else path.rmdir()


def test_garbled_messages_differ_and_never_grow() -> None:
    data = JointWire("azimuth").write(5 * 10**9, 0.1, 0.2, 0.3)
    chance = random.Random(0)
    made = [garbled(data, chance) for _ in range(200)]
    assert all(len(item) <= len(data) for item in made)
    assert sum(item != data for item in made) > 190
