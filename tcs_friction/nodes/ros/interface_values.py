"""Messages from YAML and to YAML, by the types that ROS gives their fields."""

from __future__ import annotations

import importlib
import time
from collections.abc import Mapping
from typing import Any

from tcs_friction.errors import InputError, nearest
from tcs_friction.yaml_files import dump_yaml, parse_yaml

KINDS = {"msg": "std_msgs/msg/String", "srv": "std_srvs/srv/Trigger", "action": "tcs_friction_msgs/action/Commission"}
"""A type of each kind, as an example."""
MOST_ELEMENTS = 128
"""Of a list that are shown, as ros2 does."""
FLOATS = ("double", "float")
TIME, HEADER = "builtin_interfaces/Time", "std_msgs/Header"


def interface(name: str, kind: str) -> Any:
    """The class of a type such as std_srvs/srv/Trigger; `kind` is msg, srv or action. Raises InputError."""
    package, _, rest = name.partition("/")
    middle, _, last = rest.rpartition("/")
    if middle not in ("", kind) or not last:
        raise InputError(f"type {name}", f"is not of the form PACKAGE/{kind}/NAME", KINDS[kind])
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), last)
    except (ImportError, ValueError):
        raise InputError(f"type {name}", f"no package {package} with {kind} here", KINDS[kind]) from None
    except AttributeError:
        known = [item for item in dir(importlib.import_module(f"{package}.{kind}")) if item[:1].isupper()]
        raise InputError(f"type {name}", f"{package} has no such {kind}", nearest(last, known)) from None


def from_yaml(kind: Any, text: str) -> Any:
    """A message whose fields are what a YAML mapping says; the others are zero. Raises InputError naming the field."""
    where = f"values of {kind.__name__}"
    return _filled(kind, parse_yaml(text or "{}", where), where)


def _filled(kind: Any, values: Any, where: str) -> Any:
    message = kind(check_fields=True)
    if not isinstance(values, Mapping):
        raise InputError(where, f"{values!r} is no mapping", f"for example {{{next(iter(_fields(message)), '')}: ...}}")
    fields = _fields(message)
    for name, value in values.items():
        if name not in fields:
            raise InputError(where, f"no field {name}", nearest(str(name), fields))
        try:
            setattr(message, name, _fitting(fields[name], value, getattr(message, name), f"{where}: {name}"))
        except (AssertionError, TypeError, ValueError, OverflowError) as error:
            raise InputError(f"{where}: {name}", str(error) or f"{value!r} does not fit", fields[name]) from None
    return message


def _fields(message: Any) -> dict[str, str]:
    found: dict[str, str] = message.get_fields_and_field_types()
    return found


def _fitting(declared: str, value: Any, now: Any, where: str) -> Any:
    """A value as a field of a declared type takes it. now: a value of this type."""
    element = _element(declared)
    if element and isinstance(value, list):
        inner = interface(element, "msg")() if "/" in element else None
        return [_fitting(element, item, inner, where) for item in value]
    if declared == TIME and value == "now":
        return type(now)(sec=int(time.time()), nanosec=time.time_ns() % 10**9)
    if declared == HEADER and value == "auto":
        value = {"stamp": "now"}
    if hasattr(now, "get_fields_and_field_types"):
        return _filled(type(now), value, where)
    if declared in FLOATS and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    return bytes([value]) if declared == "octet" and isinstance(value, int) else value


def _element(declared: str) -> str:
    """The type of a list's elements: of `sequence<double, 3>` and `double[3]` double; "" where it is no list."""
    if declared.startswith("sequence<"):
        return declared[len("sequence<") : -1].partition(",")[0]
    return declared.rpartition("[")[0] if declared.endswith("]") else ""


def plain(value: Any) -> Any:
    """A message, or a value of one, as mappings, lists, numbers and texts. Lists end where `ros2` ends them."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in _fields(value)}
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    if hasattr(value, "item") and not hasattr(value, "__len__"):
        return value.item()  # of a numpy array
    if isinstance(value, str | bool | int | float):
        return value
    shown = [plain(item) for item in value[:MOST_ELEMENTS]]
    return [*shown, "..."] if len(value) > MOST_ELEMENTS else shown


def as_yaml(value: Any, indent: str = "") -> str:
    """A message as YAML, each line indented."""
    text = dump_yaml(plain(value))
    return "".join(f"{indent}{line}\n" for line in text.removesuffix("...\n").splitlines())
