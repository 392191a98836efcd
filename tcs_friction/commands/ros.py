"""Ask and tell the nodes of a running graph, as `ros2` does where its command line is installed: same words, same output.

  service    list, type, call NAME TYPE ["{FIELD: VALUE}"]
  topic      list, type, info, echo, hz, pub NAME TYPE "{FIELD: VALUE}"
  param      list, get, set NODE NAME VALUE, describe, dump NODE
  lifecycle  nodes, get, set NODE TRANSITION, list
  action     list, send_goal NAME TYPE "{FIELD: VALUE}"

Only nodes on this machine are found unless the environment says otherwise, for example by ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET.
"""

from __future__ import annotations

import argparse
from typing import Any

from tcs_friction.commands.parser import positive
from tcs_friction.errors import InputError
from tcs_friction.nodes.entry import keep_logs, stay_local

Argument = tuple[tuple[str, ...], dict[str, Any]]


def _word(name: str, help_text: str, **more: Any) -> Argument:
    return (name,), {"help": help_text, "metavar": name.upper(), **more}


def _flag(*names: str, help_text: str, **more: Any) -> Argument:
    return names, {"help": help_text, **({} if more else {"action": "store_true"}), **more}


NAME = _word("name", "with its namespace, as /azimuth/joint_states")
NODE = _word("node", "with its namespace, as /azimuth/controller")
ANY_NODE = _word("node", "that one only", nargs="?", default="")
TYPE = _word("type", "PACKAGE/KIND/NAME, as std_srvs/srv/Trigger")
VALUES = _word("values", "fields in YAML, as '{mode: 1}' (default: all zero)", nargs="?", default="")
PARAMETER = _word("name", "of the parameter", metavar="PARAMETER")
LISTED = (
    _flag("-t", "--show-types", help_text="types as well"),
    _flag("-c", "--count-services", "--count-topics", "--count-actions", dest="count", help_text="how many", action="store_true"),
)
VERBS: dict[str, dict[str, tuple[str, tuple[Argument, ...]]]] = {
    "service": {
        "list": ("names", LISTED),
        "type": ("the type of a service", (NAME,)),
        "call": ("call a service", (NAME, TYPE, VALUES)),
    },
    "topic": {
        "list": ("names", LISTED),
        "type": ("the type of a topic", (NAME,)),
        "info": ("who publishes and hears it", (NAME, _flag("-v", "--verbose", help_text="each of them"))),
        "echo": (
            "its messages",
            (
                NAME,
                _word("type", "of the topic (default: what the graph says)", nargs="?", default=""),
                _flag("--once", help_text="the first only"),
                _flag("--field", metavar="A.B", default="", help_text="a part of them only"),
            ),
        ),
        "hz": (
            "how often messages come",
            (NAME, _flag("-w", "--window", type=positive, default=10000, help_text="of so many messages (default: 10000)")),
        ),
        "pub": (
            "publish messages",
            (
                NAME,
                TYPE,
                VALUES,
                _flag("-r", "--rate", type=float, default=1.0, help_text="so often a second (default: 1)"),
                _flag("-t", "--times", type=positive, default=0, help_text="so many times"),
                _flag("-1", "--once", help_text="once, as soon as somebody hears it"),
            ),
        ),
    },
    "param": {
        "list": ("names", (ANY_NODE,)),
        "get": ("a value", (NODE, PARAMETER, _flag("--hide-type", help_text="the value alone"))),
        "set": ("set a value", (NODE, PARAMETER, _word("value", "in YAML"))),
        "describe": ("unit and range", (NODE, PARAMETER)),
        "dump": ("all as a file for --params-file", (NODE,)),
    },
    "lifecycle": {
        "nodes": ("nodes that have a life cycle", LISTED[1:]),
        "get": ("the state", (ANY_NODE,)),
        "set": ("change the state", (NODE, _word("transition", "configure, activate, deactivate, cleanup, shutdown"))),
        "list": ("what can be set now", (NODE,)),
    },
    "action": {
        "list": ("names", LISTED),
        "send_goal": (
            "give a goal and wait for its end",
            (NAME, TYPE, VALUES, _flag("-f", "--feedback", help_text="how far it is, too")),
        ),
    },
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    kinds = parser.add_subparsers(dest="kind", required=True, metavar="|".join(VERBS))
    for kind, verbs in VERBS.items():
        of_kind = kinds.add_parser(kind).add_subparsers(dest="verb", required=True, metavar="|".join(verbs))
        for verb, (help_text, arguments) in verbs.items():
            of_verb = of_kind.add_parser(verb, help=help_text, description=help_text)
            for names, more in arguments:
                of_verb.add_argument(*names, **more)


def run(arguments: argparse.Namespace) -> None:
    """Do it."""
    stay_local()
    keep_logs()
    try:
        from tcs_friction.nodes.ros import verbs
    except ModuleNotFoundError as error:
        raise InputError("ros", f"needs ROS 2 ({error})", "./tcs on a machine with a C and a C++ compiler") from None
    verbs.run(arguments)
