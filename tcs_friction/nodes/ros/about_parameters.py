"""`param list|get|set|describe|dump`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterDescriptor, ParameterType
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import get_parameter_value, parameter_value_to_python

from tcs_friction.errors import JobError, nearest
from tcs_friction.nodes.ros.asker import Asker, absolute
from tcs_friction.yaml_files import dump_yaml

WORDS = {
    ParameterType.PARAMETER_BOOL: "boolean",
    ParameterType.PARAMETER_INTEGER: "integer",
    ParameterType.PARAMETER_DOUBLE: "double",
    ParameterType.PARAMETER_STRING: "string",
    ParameterType.PARAMETER_BYTE_ARRAY: "byte array",
    ParameterType.PARAMETER_BOOL_ARRAY: "boolean array",
    ParameterType.PARAMETER_INTEGER_ARRAY: "integer array",
    ParameterType.PARAMETER_DOUBLE_ARRAY: "double array",
    ParameterType.PARAMETER_STRING_ARRAY: "string array",
}


def list_parameters(asker: Asker, arguments: argparse.Namespace) -> None:
    """Names of a node's parameters, or of all nodes'."""
    nodes = [absolute(arguments.node)] if arguments.node else asker.offering("list_parameters")
    for node in nodes:
        if not arguments.node:
            print(f"{node}:")
        print("".join(f"  {name}\n" for name in _names(asker, node)), end="", flush=True)


def get_parameter(asker: Asker, arguments: argparse.Namespace) -> None:
    """Type and value."""
    value = _values(asker, absolute(arguments.node), [arguments.name])[0]
    shown = parameter_value_to_python(value)
    word = WORDS[value.type]
    label = f"{word.removesuffix(' array').capitalize()} {'values are' if word.endswith('array') else 'value is'}: "
    print(f"{'' if arguments.hide_type else label}{list(shown) if word.endswith('array') else shown}")


def set_parameter(asker: Asker, arguments: argparse.Namespace) -> None:
    """Set it, or say why the node does not take it."""
    node = absolute(arguments.node)
    item = Parameter(name=arguments.name, value=get_parameter_value(arguments.value))
    answer = asker.ask(SetParameters, node, "set_parameters", SetParameters.Request(parameters=[item]))
    result = answer.results[0]
    if not result.successful:
        raise JobError("Setting parameter failed", result.reason or f"{node} gives no reason")
    print(f"Set parameter successful{': ' if result.reason else ''}{result.reason}")


def describe_parameter(asker: Asker, arguments: argparse.Namespace) -> None:
    """What the node says of it: type, unit, range."""
    node = absolute(arguments.node)
    _values(asker, node, [arguments.name])  # which tells what there is where it is none of the node's
    request = DescribeParameters.Request(names=[arguments.name])
    found = asker.ask(DescribeParameters, node, "describe_parameters", request).descriptors[0]
    lines = [f"Parameter name: {found.name}", f"  Type: {WORDS.get(found.type, 'not set')}"]
    lines += [f"  Description: {found.description}"] if found.description else []
    print("\n".join([*lines, "  Constraints:", *_constraints(found)]))


def _constraints(found: ParameterDescriptor) -> list[str]:
    lines = ["    Read only: true"] if found.read_only else []
    for allowed in (*found.floating_point_range, *found.integer_range):
        lines += [f"    Min value: {allowed.from_value}", f"    Max value: {allowed.to_value}"]
        lines += [f"    Step: {allowed.step}"] if allowed.step else []
    if found.additional_constraints:
        lines.append(f"    Additional constraints: {found.additional_constraints}")
    return lines


def dump_parameters(asker: Asker, arguments: argparse.Namespace) -> None:
    """All of a node's parameters as a file that `--params-file` reads."""
    node = absolute(arguments.node)
    names = _names(asker, node)
    values: dict[str, Any] = {}
    for name, value in zip(names, _values(asker, node, names), strict=True):
        inner, *rest = reversed(name.split("."))
        place = values
        for part in reversed(rest):
            place = place.setdefault(part, {})
        shown = parameter_value_to_python(value)
        place[inner] = shown if shown is None or isinstance(shown, bool | int | float | str) else list(shown)
    print(dump_yaml({node: {"ros__parameters": values}}), end="")


def _names(asker: Asker, node: str) -> list[str]:
    answer = asker.ask(ListParameters, node, "list_parameters", ListParameters.Request())
    return sorted(answer.result.names)


def _values(asker: Asker, node: str, names: Sequence[str]) -> list[Any]:
    """Values of a node's parameters. Raises JobError for one that it does not have."""
    answer = asker.ask(GetParameters, node, "get_parameters", GetParameters.Request(names=list(names)))
    found = list(answer.values)
    if len(found) != len(names) or (len(names) == 1 and found[0].type == ParameterType.PARAMETER_NOT_SET):
        raise JobError(f"node {node}", f"no parameter {names[0]}", nearest(names[0], _names(asker, node)))
    return found


VERBS = {
    "list": list_parameters,
    "get": get_parameter,
    "set": set_parameter,
    "describe": describe_parameter,
    "dump": dump_parameters,
}
