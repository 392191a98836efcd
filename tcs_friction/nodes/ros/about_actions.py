"""`action list|send_goal`."""

from __future__ import annotations

import argparse
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, get_action_names_and_types

from tcs_friction.errors import JobError
from tcs_friction.nodes.ros.asker import ANSWER_LIMIT, Asker, absolute, print_names
from tcs_friction.nodes.ros.interface_values import as_yaml, from_yaml, interface

INDENT = "    "
ENDS = {
    GoalStatus.STATUS_SUCCEEDED: "SUCCEEDED",
    GoalStatus.STATUS_CANCELED: "CANCELED",
    GoalStatus.STATUS_ABORTED: "ABORTED",
}


def list_actions(asker: Asker, arguments: argparse.Namespace) -> None:
    """Names, with types if wanted."""
    print_names(asker.settled(lambda: dict(get_action_names_and_types(asker.node))), arguments.show_types, arguments.count)


def send_goal(asker: Asker, arguments: argparse.Namespace) -> None:
    """Give a goal and wait for its end; Ctrl-C cancels it. Raises JobError where it does not succeed."""
    kind, name = interface(arguments.type, "action"), absolute(arguments.name)
    goal = from_yaml(kind.Goal, arguments.values)
    client = ActionClient(asker.node, kind, name)
    try:
        print("Waiting for an action server to become available...", flush=True)
        asker.until(client.server_is_ready)
        print(f"Sending goal:\n{as_yaml(goal, INDENT)}", flush=True)
        sent = client.send_goal_async(goal, _show if arguments.feedback else None)
        asker.until(sent.done)
        handle = sent.result()
        if not handle.accepted:
            raise JobError(f"action {name}", "Goal was rejected", "another job of its node to be over")
        print(f"Goal accepted with ID: {bytes(handle.goal_id.uuid).hex()}\n", flush=True)
        _end(asker, handle, name)
    finally:
        client.destroy()


def _show(message: Any) -> None:
    print(f"Feedback:\n{as_yaml(message.feedback, INDENT)}", flush=True)


def _end(asker: Asker, handle: Any, name: str) -> None:
    """Wait for a goal's result and show it."""
    finished = handle.get_result_async()
    try:
        asker.until(finished.done)
    except KeyboardInterrupt:
        print("Canceling goal...", flush=True)
        asker.until(handle.cancel_goal_async().done, ANSWER_LIMIT)
        raise
    answer = finished.result()
    end = ENDS.get(answer.status, f"status {answer.status}")
    print(f"Result:\n{as_yaml(answer.result, INDENT)}\nGoal finished with status: {end}")
    if answer.status != GoalStatus.STATUS_SUCCEEDED:
        raise JobError(f"action {name}", f"ended as {end}", "SUCCEEDED")


VERBS = {"list": list_actions, "send_goal": send_goal}
