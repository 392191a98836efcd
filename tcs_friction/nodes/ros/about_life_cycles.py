"""`lifecycle nodes|get|set|list`."""

from __future__ import annotations

import argparse
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState

from tcs_friction.errors import JobError
from tcs_friction.nodes.ros.asker import Asker, absolute


def list_managed(asker: Asker, arguments: argparse.Namespace) -> None:
    """Nodes that have a life cycle."""
    nodes = asker.offering("get_available_transitions")
    print(len(nodes) if arguments.count else "\n".join(nodes))


def get_state(asker: Asker, arguments: argparse.Namespace) -> None:
    """The state of a node, or of all that have one."""
    for node in [arguments.node] if arguments.node else asker.offering("get_available_transitions"):
        state = asker.ask(GetState, absolute(node), "get_state", GetState.Request()).current_state
        print(f"{'' if arguments.node else f'{node}: '}{state.label} [{state.id}]")


def set_state(asker: Asker, arguments: argparse.Namespace) -> None:
    """Trigger a transition, by its name or number."""
    node = absolute(arguments.node)
    offered = {entry.transition.label: entry.transition.id for entry in _transitions(asker, node)}
    wanted = arguments.transition
    number = next((number for name, number in offered.items() if wanted in (name, str(number))), None)
    if number is None:
        raise JobError(f"node {node}", f"no transition {wanted} from its state", f"one of {', '.join(offered)}")
    request = ChangeState.Request(transition=Transition(id=number))
    if not asker.ask(ChangeState, node, "change_state", request, times=1).success:
        raise JobError(f"node {node}", f"transition {wanted} failed")
    print("Transitioning successful")


def list_transitions(asker: Asker, arguments: argparse.Namespace) -> None:
    """What is possible from the state in which the node is."""
    for entry in _transitions(asker, absolute(arguments.node)):
        print(f"- {entry.transition.label} [{entry.transition.id}]")
        print(f"\tStart: {entry.start_state.label}\n\tGoal: {entry.goal_state.label}")


def _transitions(asker: Asker, node: str) -> list[Any]:
    answer = asker.ask(GetAvailableTransitions, node, "get_available_transitions", GetAvailableTransitions.Request())
    return list(answer.available_transitions)


VERBS = {"nodes": list_managed, "get": get_state, "set": set_state, "list": list_transitions}
