"""ROS parameters of a frozen configuration: its settings declare descriptors, and a change is applied whole or refused."""

from __future__ import annotations

import importlib
from collections.abc import Collection, Sequence
from dataclasses import is_dataclass, replace
from types import ModuleType
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from tcs_friction.control.config_field import Setting, changed, flatten, parts, settings, validate
from tcs_friction.errors import InputError, nearest

Config = TypeVar("Config")


def descriptor(entry: Setting) -> ParameterDescriptor:
    """What `ros2 param describe` shows: description with unit, range, options; read-only what is fixed."""
    unit = f" [{entry.unit}]" if entry.unit else ""
    described = ParameterDescriptor(description=entry.description + unit, read_only=entry.fixed)
    if entry.options:
        described.additional_constraints = "one of " + ", ".join(entry.options)
    elif isinstance(entry.default, float):
        described.floating_point_range = [FloatingPointRange(from_value=entry.lower, to_value=entry.upper)]
        described.dynamic_typing = True  # so that 10 may be written for 10.0; other types are refused by the setting
    elif isinstance(entry.default, int) and not isinstance(entry.default, bool):
        described.integer_range = [IntegerRange(from_value=int(entry.lower or 0), to_value=int(entry.upper or 0))]
    return described


def declare(node: Node, config: Config, fixed: bool = False) -> Config:
    """Declares every setting with the configuration's value as default; returns the configuration with what the user gave.

    With `fixed` none of them can be changed later.
    Raises InputError naming the node, the parameter, what was found and what was expected.
    """
    given: dict[str, Any] = {}
    for name, (entry, value) in flatten(config).items():
        try:
            given[name] = _given(node, replace(entry, fixed=fixed or entry.fixed), name, value)
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            reason = str(error).rpartition("Reason: ")[2].removesuffix(f": {name}")
            raise InputError(node.get_name(), reason) from None
    result = changed(config, given)
    validate(result, f"{node.get_name()}: parameters")
    return result


def _given(node: Node, entry: Setting, name: str, value: Any) -> Any:
    """Declares one parameter; what it is then."""
    return node.declare_parameter(name, as_ros(value), descriptor(entry)).value


def as_ros(value: Any) -> Any:
    """A value as a parameter has it: an empty list is [""]."""
    return (list(value) or [""]) if isinstance(value, list | tuple) else value


def refuse_unknown(node: Node) -> None:
    """Raises InputError for a parameter given at the start that no node has: a misspelt limit must not pass as the default.

    What another node of the graph has is no mistake, for arguments may be meant for all nodes.
    """
    own = node._parameters
    for name in node._parameter_overrides:
        if name not in own and not name.startswith("qos_overrides.") and not of_another_node(name):
            expected = nearest(name, [entry for entry in own if not entry.startswith("qos_overrides.")])
            raise InputError(node.get_name(), f"no parameter {name}", expected)


def of_another_node(name: str) -> bool:
    """Whether some node of the package has this parameter. Nodes are imported one after the other until one has."""
    graph = importlib.import_module("tcs_friction.nodes.graph")
    modules = (importlib.import_module(graph.module_of(node)) for node in graph.node_names())
    return any(name in _names(kind) for module in modules for kind in _configurations(module))


def _configurations(module: ModuleType) -> list[type[Any]]:
    own = [kind for kind in vars(module).values() if isinstance(kind, type) and kind.__module__ == module.__name__]
    return [kind for kind in own if is_dataclass(kind) and kind.__name__.endswith("Config")]


def _names(kind: type[Any], prefix: str = "") -> set[str]:
    own = {prefix + entry.name for entry in settings(kind)}
    return own.union(*(_names(part, f"{prefix}{name}.") for name, part in parts(kind).items()))


def as_parameters(config: Any) -> list[Parameter]:
    """A configuration's settings as ROS parameters, without those that are fixed."""
    return [Parameter(name, value=as_ros(value)) for name, (entry, value) in flatten(config).items() if not entry.fixed]


def given(node: Node) -> set[str]:
    """Names of the parameters that were given at the start, on the command line or in a file."""
    return set(node._parameter_overrides) & set(node._parameters)


def keep(config: Config, before: Config, names: Collection[str]) -> Config:
    """A configuration with those settings of the one before that are fixed or named."""
    return changed(config, {name: value for name, (entry, value) in flatten(before).items() if entry.fixed or name in names})


def with_parameters(config: Config, parameters: Sequence[Parameter], where: str) -> Config:
    """The configuration after a change of parameters; raises InputError with the reason when it would be bad."""
    known = flatten(config)
    result = changed(config, {item.name: item.value for item in parameters if item.name in known})
    validate(result, where)
    return result
