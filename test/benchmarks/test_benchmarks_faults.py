"""The benchmark of faults, short, with all its checks; garbled messages are garbled."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys

from benchmarks.faulty_nodes import garbled
from tcs_friction.nodes.wire import JointWire


def test_the_loop_keeps_its_limits_and_resumes_after_faults() -> None:
    command = [sys.executable, "-P", "-m", "tcs_friction.cli", "bench", "faults", "--minutes", "0.35", "--json"]
    environment = os.environ | {"ROS_DOMAIN_ID": str(1 + os.getpid() % 100), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    ended = subprocess.run(command, capture_output=True, text=True, timeout=250, env=environment, check=False)
    assert ended.returncode == 0, ended.stderr
    results = {entry["name"]: entry for entry in json.loads(ended.stdout)["results"]}
    assert sum(entry["value"] for name, entry in results.items() if name.startswith("faults")) >= 2
    for name in ("largest true speed, beside its limit", "largest torque, beside its limit"):
        assert 0.0 < results[name]["value"] <= results[name]["beside"]
    assert results["inputs refused"]["value"] > 0


def test_garbled_messages_differ_and_never_grow() -> None:
    data = JointWire("azimuth").write(5 * 10**9, 0.1, 0.2, 0.3)
    chance = random.Random(0)
    made = [garbled(data, chance) for _ in range(200)]
    assert all(len(item) <= len(data) for item in made)
    assert sum(item != data for item in made) > 190
