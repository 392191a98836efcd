"""How messages travel is what docs/real-time.md says of it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from conftest import ROOT

TALK = """
import sys, time
import tcs_friction.nodes
import rclpy
from std_msgs.msg import String

heard = []
contexts = [rclpy.Context() for _ in range(2)]
for context in contexts:
    rclpy.init(context=context)
speaker, listener = [rclpy.create_node(name, context=context) for name, context in zip(("speaker", "listener"), contexts)]
publisher = speaker.create_publisher(String, "words", 10)
listener.create_subscription(String, "words", heard.append, 10)
executor = rclpy.executors.SingleThreadedExecutor(context=contexts[1])
executor.add_node(listener)
end = time.monotonic() + 20.0
while not heard and time.monotonic() < end:
    publisher.publish(String(data="a"))
    executor.spin_once(timeout_sec=0.05)
print(bool(heard), any("/dev/shm/fastrtps" in line for line in open("/proc/self/maps")))
"""
PROFILE = str(ROOT / "security/loopback_udp.xml")


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize(
    ("variables", "shared_memory"),
    [
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, True),
        ({"FASTRTPS_DEFAULT_PROFILES_FILE": PROFILE}, False),
    ],
)
def test_shared_memory_is_used_where_the_documentation_says_so(variables: dict[str, str], shared_memory: bool) -> None:
    env = {name: value for name, value in os.environ.items() if name != "ROS_AUTOMATIC_DISCOVERY_RANGE"}
    env |= {"PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}", **variables}
    if env.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp") != "rmw_fastrtps_cpp":
        pytest.skip("of Fast DDS only")
    done = subprocess.run([sys.executable, "-c", TALK], env=env, capture_output=True, text=True, check=False)
    assert done.stdout == f"True {shared_memory}\n", done.stderr
