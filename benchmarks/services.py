"""Every service of every node called at random while messages flow: how many answers come, and how long they take.

A graph of its own in real time, a process for each node; when one of them dies the benchmark fails. Requests are good and
bad: parameters set to what they are and to what they cannot be, modes, calibrations, jobs that are already running.
"""

from __future__ import annotations

import argparse
import importlib
import math
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from typing import Any

from tcs_friction.commands.parser import positive
from tcs_friction.errors import JobError

AT_ONCE = 8
"""Calls on their way."""
PATIENCE = 30.0
"""s for an answer; a job that is refused answers at once, one that runs may take longer, and is called on the side."""
SETTLED = 5.0
"""s without a new service, after which discovery is taken to be over."""
JOBS = ("identify", "diagnose", "calibrate")
ARGUMENTS = ("clock:=real_time", "period:=0.005", "dynamometer:=50.0", "switch1:=true", "switch2:=true")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this benchmark."""
    parser.add_argument("--minutes", type=float, default=3.0)
    parser.add_argument("--seed", type=positive, default=1)


def run(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows: services, calls, calls without an answer, the longest wait for one."""
    import rclpy

    from tcs_friction.nodes.graph import GRAPH

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    with tempfile.TemporaryDirectory() as folder:
        words = [word for entry in (*ARGUMENTS, f"results:={folder}") for word in ("-p", entry)]
        command = [sys.executable, "-P", "-m", "tcs_friction.cli", "graph", "--processes", "--ros-args", *words]
        graph = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        rclpy.init(args=[])
        node = rclpy.create_node("stress", namespace="azimuth")
        try:
            stress = Stress(node, arguments.seed)
            stress.find(GRAPH)
            stress.run(60.0 * arguments.minutes)
            if graph.poll() is not None:
                raise JobError("bench services", "a node died", "all of them to live")
        finally:
            node.destroy_node()
            rclpy.shutdown()
            graph.send_signal(signal.SIGINT)
            graph.wait(60.0)
    return [
        {"name": "services", "value": len(stress.services), "unit": "1"},
        {"name": "calls", "value": sum(stress.calls.values()), "unit": "1"},
        {"name": "calls without an answer", "value": len(stress.unanswered), "unit": "1"},
        {"name": "longest wait", "value": stress.longest, "unit": "s"},
    ]


class Stress:
    """Calls services of other nodes from this one, several at a time."""

    def __init__(self, node: Any, seed: int) -> None:
        from rclpy.executors import SingleThreadedExecutor

        self._node, self._random = node, random.Random(seed)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._clients: dict[str, Any] = {}
        self._pending: list[tuple[str, Any, float]] = []
        self._values: dict[str, list[Any]] = {}
        self.services: dict[str, str] = {}
        """Name to type of everything that is called."""
        self.calls: Counter[str] = Counter()
        self.unanswered: list[str] = []
        self.longest = 0.0

    def find(self, names: tuple[str, ...], limit: float = 200.0) -> None:
        """Wait for nodes and list their services, when no more of them turn up. Raises JobError when a node does not come."""
        deadline, since = time.monotonic() + limit, time.monotonic()
        while not self.services or time.monotonic() - since < SETTLED:
            self._executor.spin_once(timeout_sec=0.1)
            lacking = set(names) - set(self._node.get_node_names())
            if time.monotonic() > deadline:
                raise JobError("bench services", f"no node {', '.join(lacking)}", "all of the graph")
            found = {} if lacking else self._services_of(names)
            if len(found) > len(self.services):
                self.services, since = found, time.monotonic()

    def _services_of(self, names: tuple[str, ...]) -> dict[str, str]:
        namespace = self._node.get_namespace()
        lists = [self._node.get_service_names_and_types_by_node(name, namespace) for name in names]
        return {service: types[0] for entries in lists for service, types in entries if "/_action/" not in service}

    def run(self, seconds: float, least: int = 0) -> None:
        """Call for a while, and `least` times at least, then wait for what is on its way."""
        end = time.monotonic() + seconds
        names = sorted(self.services)
        while time.monotonic() < end or (sum(self.calls.values()) < least and not self.unanswered):
            while len(self._pending) < AT_ONCE and (ready := [name for name in names if self._client(name).service_is_ready()]):
                self._call(self._random.choice(ready))
            self._turn()
        while self._pending:
            self._turn()

    def _turn(self) -> None:
        self._executor.spin_once(timeout_sec=0.05)
        self._collect()

    def _client(self, name: str) -> Any:
        if name not in self._clients:
            package, _, kind = self.services[name].split("/")
            service = getattr(importlib.import_module(f"{package}.srv"), kind)
            self._clients[name] = self._node.create_client(service, name)
        return self._clients[name]

    def _call(self, name: str) -> None:
        client = self._client(name)
        self.calls[name] += 1
        future = client.call_async(self._request(client.srv_type, name))
        if not name.endswith(JOBS):
            self._pending.append((name, future, time.monotonic()))

    def _collect(self) -> None:
        now = time.monotonic()
        for entry in list(self._pending):
            name, future, since = entry
            if future.done():
                self.longest = max(self.longest, now - since)
                self._learn(name, future.result())
            elif now - since < PATIENCE:
                continue
            else:
                self.unanswered.append(name)
            self._pending.remove(entry)

    def _learn(self, name: str, answer: Any) -> None:
        """Names of parameters, for the requests to come."""
        if name.endswith("list_parameters"):
            self._values[name.rpartition("/")[0]] = list(answer.result.names)

    def _request(self, service: Any, name: str) -> Any:
        from rcl_interfaces.msg import ParameterType, ParameterValue

        request, draw = service.Request(), self._random
        parameters = self._values.get(name.rpartition("/")[0], [])
        chosen = draw.sample(parameters, min(3, len(parameters)))
        if hasattr(request, "names"):
            request.names = chosen or ["nothing"]
        elif hasattr(request, "parameters") and chosen:
            bad = draw.choice([math.nan, math.inf, -1e300])
            value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=bad)
            request.parameters = [_parameter(entry, value) for entry in chosen]
        elif hasattr(request, "mode"):
            request.mode = draw.randrange(5)
        elif hasattr(request, "directory"):
            request.directory = draw.choice(["", f"stress{draw.random()}", "/etc", "../up"])
            request.axis = draw.choice(["", "", "nowhere.yaml", "/etc/passwd"])
        return request


def _parameter(name: str, value: Any) -> Any:
    from rcl_interfaces.msg import Parameter

    return Parameter(name=name, value=value)
