"""Settings of a configuration: default, unit, range and description, declared once beside the field itself.

A configuration is a frozen dataclass whose fields are made with `setting` or `choice`. ROS parameter
descriptors, validation and files all read the same declaration:

    @dataclass(frozen=True)
    class ObserverConfig:
        bandwidth: float = setting(10.0, "Hz", 0.1, 200.0, "cut-off of the Q filter")
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar, cast

from tcs_friction.errors import InputError, nearest

Config = TypeVar("Config")
_KEY = "setting"


@dataclass(frozen=True)
class Setting:
    """What is declared of one field. `lower` and `upper` are inclusive; a `choice` has `options` instead.

    What is `fixed` holds from the start of a node to its end.
    """

    name: str
    default: float | int | bool | str | tuple[str, ...]
    unit: str
    lower: float | None
    upper: float | None
    description: str
    options: tuple[str, ...] = ()
    fixed: bool = False

    def problem(self, value: object) -> tuple[str, str] | None:
        """What is wrong with a value and what was expected, or None when it may be used."""
        if isinstance(self.default, tuple):
            good = isinstance(value, tuple) and all(isinstance(item, str) for item in value)
            return None if good else (repr(value), "a list of texts")
        if isinstance(self.default, str) and not self.options:
            return None if isinstance(value, str) else (repr(value), "a text")
        if isinstance(self.default, str):
            return None if value in self.options else (repr(value), "one of " + ", ".join(self.options))
        if isinstance(self.default, bool):
            return None if isinstance(value, bool) else (repr(value), "true or false")
        number = "a whole number" if isinstance(self.default, int) else "a number"
        within = f"{number} from {self.lower:g} to {self.upper:g} {self.unit}".rstrip()
        kinds = (int,) if isinstance(self.default, int) else (int, float)
        if isinstance(value, bool) or not isinstance(value, kinds):
            return repr(value), within
        # written so that NaN, which compares false with everything, is refused
        if not (cast(float, self.lower) <= value <= cast(float, self.upper)):
            return f"{value:g}", within
        return None


def setting(default: float, unit: str, lower: float, upper: float, description: str, fixed: bool = False) -> Any:
    """A number (or a bool) with its unit and inclusive range; an int default makes a whole number.

    The default must lie in the range: a wrong declaration raises ValueError where the class is written.
    """
    if not (lower <= default <= upper) or not math.isfinite(default):
        raise ValueError(f"default {default!r} of a setting is outside its range {lower!r} to {upper!r}")
    return field(default=default, metadata={_KEY: (unit, lower, upper, description, (), fixed)})


def switch(default: bool, description: str, fixed: bool = False) -> Any:
    """A setting that is true or false."""
    return field(default=default, metadata={_KEY: ("", None, None, description, (), fixed)})


def choice(default: str, options: Sequence[str], description: str, fixed: bool = False) -> Any:
    """A setting that is one of the named options."""
    if default not in options:
        raise ValueError(f"default {default!r} of a setting is not one of {', '.join(options)}")
    return field(default=default, metadata={_KEY: ("", None, None, description, tuple(options), fixed)})


def text(default: str, description: str, fixed: bool = False) -> Any:
    """A setting that is any text, such as the path of a file."""
    return field(default=default, metadata={_KEY: ("", None, None, description, (), fixed)})


def texts(description: str, fixed: bool = False) -> Any:
    """A setting that is a list of texts, none by default."""
    return field(default=(), metadata={_KEY: ("", None, None, description, (), fixed)})


def settings(config: type[Any] | Any) -> tuple[Setting, ...]:
    """The declared settings of a configuration class or object, in order of declaration."""
    return tuple(_setting_of(entry) for entry in fields(config) if _KEY in entry.metadata)


def _setting_of(entry: Field[Any]) -> Setting:
    assert entry.default is not MISSING
    return Setting(entry.name, entry.default, *entry.metadata[_KEY])


def parts(config: type[Any] | Any) -> dict[str, type[Any]]:
    """The nested configurations of a configuration class or object: field name to class."""
    return {
        entry.name: cast(type[Any], entry.default_factory)
        for entry in fields(config)
        if _KEY not in entry.metadata and is_dataclass(entry.default_factory)
    }


def validate(config: Any, where: str) -> None:
    """Refuse a configuration with any bad value, nested ones included; InputError names every one of them.

    A configuration whose values may be good one by one and yet not together has a method `conflict` that lists what is wrong.
    """
    found = _problems(config, "")
    if found:
        raise InputError(where, "; ".join(found))


def _problems(config: Any, prefix: str) -> list[str]:
    found: list[str] = []
    for declared in settings(config):
        problem = declared.problem(getattr(config, declared.name))
        if problem is not None:
            found.append(f"{prefix}{declared.name} is {problem[0]}, expected {problem[1]}")
    if not found and hasattr(config, "conflict"):
        found += [prefix + problem for problem in config.conflict()]
    for name in parts(config):
        found += _problems(getattr(config, name), f"{prefix}{name}.")
    return found


def from_mapping(config_class: type[Config], mapping: object, where: str) -> Config:
    """A validated configuration from a file's mapping; absent keys take their defaults.

    Raises InputError for an unknown key (naming the nearest known one) and for any value out of its range.
    """
    config = _build(config_class, mapping, where)
    validate(config, where)
    return config


def _build(config_class: type[Config], mapping: object, where: str) -> Config:
    if not isinstance(mapping, Mapping):
        raise InputError(where, f"{mapping!r}", "a mapping of settings")
    declared = {entry.name: entry for entry in settings(config_class)}
    nested = parts(config_class)
    values: dict[str, Any] = {}
    for key, value in mapping.items():
        if key in nested:
            values[key] = _build(nested[key], value, f"{where} {key}")
        elif key in declared:
            values[key] = float(value) if isinstance(declared[key].default, float) and type(value) is int else value
        else:
            raise InputError(where, f"unknown key {key!r}", nearest(str(key), [*declared, *nested]))
    return config_class(**values)


def flatten(config: Any, prefix: str = "") -> dict[str, tuple[Setting, Any]]:
    """Every setting of a configuration with its value, by parameter name; nested ones are `part.name`."""
    flat = {prefix + entry.name: (entry, getattr(config, entry.name)) for entry in settings(config)}
    for name in parts(config):
        flat.update(flatten(getattr(config, name), f"{prefix}{name}."))
    return flat


def changed(config: Config, changes: Mapping[str, Any]) -> Config:
    """The configuration with the named settings changed; whole numbers serve where numbers are meant."""
    own: dict[str, Any] = {}
    for entry in settings(config):
        if entry.name in changes:
            value = changes[entry.name]
            own[entry.name] = _as_declared(entry, value)
    for part in parts(config):
        inner = {name.partition(".")[2]: value for name, value in changes.items() if name.startswith(f"{part}.")}
        if inner:
            own[part] = changed(getattr(config, part), inner)
    return cast(Config, replace(cast(Any, config), **own))


def _as_declared(entry: Setting, value: Any) -> Any:
    """A whole number serves where a number is meant, and an empty list is [""], for ROS gives an empty one no type."""
    if isinstance(entry.default, tuple) and isinstance(value, list | tuple):
        return tuple(item for item in value if item != "")
    return float(value) if isinstance(entry.default, float) and type(value) is int else value
