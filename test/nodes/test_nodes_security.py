"""The SROS 2 policy allows what the nodes of the graph do, and nothing else."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.action import get_action_client_names_and_types_by_node, get_action_server_names_and_types_by_node

from tcs_friction.nodes.graph import BESIDE, GRAPH, PLANTS, node_names

POLICY = Path(__file__).resolve().parents[2] / "security" / "policy.xml"
NAMESPACE = "/azimuth"
RULES = {
    "topics": ("topic", ("publish", "subscribe")),
    "services": ("service", ("reply", "request")),
    "actions": ("action", ("execute", "call")),
}
"""What SROS 2's schema 0.2.0 allows in a profile."""


def policy() -> dict[str, dict[str, set[str]]]:
    """By node and rule the full names that are allowed; the form is checked on the way."""
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    found: dict[str, dict[str, set[str]]] = {}
    for enclave in root.findall("./enclaves/enclave"):
        (profile,) = enclave.findall("./profiles/profile")
        name = profile.attrib["node"]
        assert profile.attrib["ns"] == NAMESPACE
        assert enclave.attrib["path"] == f"{NAMESPACE}/{name}"
        rules = found[name] = {rule: set[str]() for _, names in RULES.values() for rule in names}
        for block in profile:
            item, allowed = RULES[block.tag]
            ((rule, value),) = block.attrib.items()
            assert rule in allowed
            assert value == "ALLOW"
            assert len(block)
            for entry in block:
                assert entry.tag == item
                rules[rule].add(full(str(entry.text), name))
    return found


def full(name: str, node: str) -> str:
    if name.startswith("~/"):
        return f"{NAMESPACE}/{node}{name[1:]}"
    return name if name.startswith("/") else f"{NAMESPACE}/{name}"


def of_node(watcher: Any, node: str) -> dict[str, set[str]]:
    """What a running node does, in the words of the policy."""

    def names(found: list[tuple[str, list[str]]]) -> set[str]:
        return {name for name, _ in found if "/_action/" not in name}

    return {
        "publish": names(watcher.get_publisher_names_and_types_by_node(node, NAMESPACE)),
        "subscribe": names(watcher.get_subscriber_names_and_types_by_node(node, NAMESPACE)),
        "reply": names(watcher.get_service_names_and_types_by_node(node, NAMESPACE)),
        "request": names(watcher.get_client_names_and_types_by_node(node, NAMESPACE)),
        "execute": names(get_action_server_names_and_types_by_node(watcher, node, NAMESPACE)),
        "call": names(get_action_client_names_and_types_by_node(watcher, node, NAMESPACE)),
    }


EVERYWHERE = {"subscribe": {"/parameter_events", "/clock"}, "publish": {"/parameter_events", "/rosout"}}
"""Used by nodes with simulated time, or with a logger that publishes."""


def test_the_policy_is_what_the_nodes_do(together: Callable[..., Any]) -> None:
    allowed = policy()
    assert set(allowed) == {*node_names(), "live"} - set(PLANTS), "what takes the plant's place has its name"
    together_made = (*GRAPH, *BESIDE)
    graph = together(nodes=together_made)

    def unused(name: str) -> dict[str, set[str]]:
        does = of_node(graph.driver, name)
        rules = ("publish", "subscribe", "reply", "execute", "call")
        left = {rule: allowed[name][rule] - does[rule] - EVERYWHERE.get(rule, set()) for rule in rules}
        return {rule: names for rule, names in left.items() if names}

    for name in together_made:  # discovery takes a while, node by node and topic by topic
        assert graph.until(lambda name=name: not unused(name)), f"{name}: allowed, and not done: {unused(name)}"
    graph.for_seconds(1.0)
    for name in together_made:
        for rule, names in of_node(graph.driver, name).items():
            more = names - allowed[name][rule]
            assert not more, f"{name} {rule}: not allowed, and done"
        assert not unused(name), f"{name}: allowed, and done no longer"
