"""YAML files by anybody: read within bounds of time and memory, refused in one line.

A file is gone over twice. The first time looks at its events only: how deep it nests, how much it stands for when its aliases
are written out, whether a key comes twice. The second builds mappings, lists, texts and numbers.

What is a number follows the core schema of YAML 1.2 (section 10.3.2 of its specification): 1e3 is one; 1:30, yes and a date are
texts, of which YAML 1.1 makes 90, true and a date. 017, which is a number in both and not the same, is refused.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from yaml.constructor import ConstructorError
from yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    MappingStartEvent,
    NodeEvent,
    ScalarEvent,
)

from tcs_friction.errors import InputError
from tcs_friction.plain_files import read_plain

LARGEST = 4 << 20
"""Bytes of a file: as many values with 17 digits each have 2 MB."""
MOST_VALUES = 100_000
"""Values and keys that a file stands for, what its aliases repeat included; they are read in one to two seconds."""
DEEPEST = 32
"""Nested lists and mappings: an axis file has 7."""
LONGEST_NUMBER = 400
"""Characters; the largest number there is has 309 digits."""

_Base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the same in C where PyYAML was built with it
_TAG = "tag:yaml.org,2002:"
_CORE: dict[str, tuple[str, str]] = {
    "null": (r"~|null|Null|NULL|", "~nN"),
    "bool": (r"true|True|TRUE|false|False|FALSE", "tTfF"),
    "int": (r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    "float": (r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)", "-+.0123456789"),
    "merge": (r"<<", "<"),
}
"""Scalars that are no text: the pattern of all of it, and what it may begin with. Merge keys are of YAML 1.1 and no number."""
_OCTAL = re.compile(r"[-+]?0[0-9]+")
"""A whole number that YAML 1.1 reads to the base 8, and YAML 1.2 to the base 10."""


class _Loader(_Base):
    """The safe loader of the core schema; what a value cannot be is an error with its place."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if isinstance(node, yaml.ScalarNode) and node.tag != f"{_TAG}str":
            return self._scalar(node)
        return super().construct_object(node, deep)

    def _scalar(self, node: yaml.ScalarNode) -> Any:
        kind = node.tag.rpartition(":")[2]
        if kind in ("int", "float") and len(node.value) > LONGEST_NUMBER:
            raise ConstructorError(None, None, f"a number of {len(node.value)} characters", node.start_mark)
        if kind == "int" and _OCTAL.fullmatch(node.value):
            either = f"{node.value} is to the base 8 for YAML 1.1 and to the base 10 for YAML 1.2"
            raise ConstructorError(None, None, f"{either}, expected no leading 0, or quotes around a text", node.start_mark)
        try:
            if kind in ("int", "float", "bool") and not re.fullmatch(_CORE[kind][0], node.value):
                raise ValueError  # a tag that somebody wrote
            value = super().construct_object(node)
            if isinstance(value, int):
                float(value)
        except (ValueError, OverflowError, KeyError, IndexError, AttributeError):
            raise ConstructorError(None, None, f"{node.value[:40]!r} cannot be used as {kind}", node.start_mark) from None
        return value


class _Dumper(yaml.SafeDumper):
    """Quotes a text that any YAML would read as something else."""


_Loader.yaml_implicit_resolvers = {}
for _kind, (_pattern, _first) in _CORE.items():
    for _class in (_Loader, _Dumper):
        _class.add_implicit_resolver(f"{_TAG}{_kind}", re.compile(rf"(?:{_pattern})\Z"), list(_first) + [""] * (_kind == "null"))


def dump_yaml(content: Any, width: int = 110, flow: bool | None = False) -> str:
    """YAML that `parse_yaml` reads back. flow: whether lists and mappings stand in one line; None: the innermost ones."""
    return str(yaml.dump(content, Dumper=_Dumper, sort_keys=False, width=width, default_flow_style=flow))


def load_yaml(path: Path, what: str = "a YAML file") -> Mapping[str, Any]:
    """A YAML file whose top level is a mapping; `what` is expected where there is none. InputError in one line otherwise."""
    content = load_yaml_of_any_kind(path, what)
    if not isinstance(content, Mapping):
        raise InputError(str(path), f"{type(content).__name__} {str(content)[:40]!r}", "a mapping")
    return content


def load_yaml_of_any_kind(path: Path, what: str = "a YAML file") -> Any:
    """The same whatever its top level is."""
    data = read_plain(Path(path), LARGEST + 1, what)
    return parse_yaml(data, str(path))


def parse_yaml(data: bytes | str, where: str) -> Any:
    """What a YAML text says. Raises InputError naming `where`, and the line."""
    if len(data) > LARGEST:
        raise InputError(where, "is too large", f"at most {LARGEST >> 20} MB of YAML")
    try:
        text = data.decode() if isinstance(data, bytes) else data
        _Survey(where).go_over(text)
        return yaml.load(text, Loader=_Loader)
    except UnicodeDecodeError as error:
        raise InputError(where, f"is not YAML ({error})") from None
    except yaml.MarkedYAMLError as error:
        problem = _cut(error.problem or error.context or "no reason given")
        found = problem if isinstance(error, ConstructorError) else f"is not YAML ({problem})"
        raise InputError(_place(where, error.problem_mark), found) from None
    except yaml.YAMLError as error:
        raise InputError(where, f"is not YAML ({_cut(str(error))})") from None


def _place(where: str, mark: Any) -> str:
    return where if mark is None else f"{where}: line {mark.line + 1}"


def _cut(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) < 200 else f"{line[:200]} ..."


@dataclass
class _Open:
    """A list or mapping that has begun: what it stands for so far, how deep it is, and the keys of a mapping."""

    anchor: str | None
    keys: set[str] | None
    size: int = 1
    depth: int = 1
    entries: int = 0


class _Survey:
    """The first time through a file: raises InputError where one of the bounds is passed or a key comes twice."""

    def __init__(self, where: str) -> None:
        self._where = where
        self._open: list[_Open] = []
        self._anchors: dict[str, tuple[int, int]] = {}  # size and depth of what each stands for; 0 until it has ended
        self._total = 0

    def go_over(self, text: str) -> None:
        for event in yaml.parse(text, Loader=_Base):
            if isinstance(event, CollectionEndEvent):
                closed = self._open.pop()
                self._stands(closed.anchor, closed.size, closed.depth)
            elif isinstance(event, NodeEvent):
                self._look_for_twins(event)
                self._look_at_size(event)

    def _look_at_size(self, event: NodeEvent) -> None:
        size, depth = 1, 0
        if isinstance(event, AliasEvent):
            size, depth = self._anchors.get(str(event.anchor), (1, 0))  # an unknown one is refused when the values are built
            if not size:
                self._refuse(event, f"*{str(event.anchor)[:40]} is a part of itself", "an alias of something before it")
        elif isinstance(event, CollectionStartEvent):
            depth = 1
        self._total += size
        if self._total > MOST_VALUES:
            self._refuse(event, "stands for too many values", f"at most {MOST_VALUES}, aliases written out")
        if len(self._open) + depth > DEEPEST:
            self._refuse(event, "nests too deep", f"at most {DEEPEST} lists and mappings inside each other")
        if isinstance(event, CollectionStartEvent):
            if event.anchor is not None:
                self._anchors[event.anchor] = (0, 0)
            self._open.append(_Open(event.anchor, set() if isinstance(event, MappingStartEvent) else None))
        else:
            self._stands(None if isinstance(event, AliasEvent) else event.anchor, size, depth)

    def _stands(self, anchor: str | None, size: int, depth: int) -> None:
        """Something has ended: its anchor stands for it, and what it is in has grown."""
        if anchor is not None:
            self._anchors[anchor] = (size, depth)
        if self._open:
            around = self._open[-1]
            around.size += size
            around.depth = max(around.depth, 1 + depth)

    def _look_for_twins(self, event: NodeEvent) -> None:
        """Keys and values of a mapping take turns."""
        around = self._open[-1] if self._open else None
        keys = around.keys if around is not None else None
        if around is None or keys is None:
            return
        around.entries += 1
        if around.entries % 2 and isinstance(event, ScalarEvent):
            if event.value in keys:
                self._refuse(event, f"key {_cut(event.value)!r} comes twice", "each key once")
            keys.add(event.value)

    def _refuse(self, event: NodeEvent, found: str, expected: str) -> None:
        raise InputError(_place(self._where, event.start_mark), found, expected)
