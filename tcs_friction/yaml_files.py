"""YAML files by anybody: read within bounds of time and memory, refused in one line.

A file is gone over twice. The first time looks at its events only: how deep it nests, how much it stands for when its aliases
are written out, whether a key comes twice. The second builds mappings, lists, texts and numbers. Dates are texts.
"""

from __future__ import annotations

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

LARGEST = 4 << 20
"""Bytes of a file: as many values with 17 digits each have 2 MB."""
MOST_VALUES = 100_000
"""Values and keys that a file stands for, what its aliases repeat included; they are read in one to two seconds."""
DEEPEST = 32
"""Nested lists and mappings: an axis file has 7."""
LONGEST_NUMBER = 400
"""Characters; the largest number there is has 309 digits."""

_Base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the same in C where PyYAML was built with it


class _Loader(_Base):
    """The safe loader without dates; what a value cannot be is an error with its place."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if isinstance(node, yaml.ScalarNode) and node.tag != "tag:yaml.org,2002:str":
            return self._scalar(node)
        return super().construct_object(node, deep)

    def _scalar(self, node: yaml.ScalarNode) -> Any:
        kind = node.tag.rpartition(":")[2]
        if kind in ("int", "float") and len(node.value) > LONGEST_NUMBER:
            raise ConstructorError(None, None, f"a number of {len(node.value)} characters", node.start_mark)
        try:
            value = super().construct_object(node)
            if isinstance(value, int):
                float(value)
        except (ValueError, OverflowError, KeyError, IndexError, AttributeError):
            raise ConstructorError(None, None, f"{node.value[:40]!r} cannot be used as {kind}", node.start_mark) from None
        return value


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if not tag.endswith(":timestamp")]
    for first, resolvers in _Base.yaml_implicit_resolvers.items()
}


def load_yaml(path: Path, what: str = "a YAML file") -> Mapping[str, Any]:
    """A YAML file whose top level is a mapping; `what` is expected where there is none. InputError in one line otherwise."""
    content = load_yaml_of_any_kind(path, what)
    if not isinstance(content, Mapping):
        raise InputError(str(path), f"{type(content).__name__} {str(content)[:40]!r}", "a mapping")
    return content


def load_yaml_of_any_kind(path: Path, what: str = "a YAML file") -> Any:
    """The same whatever its top level is."""
    try:
        with Path(path).open("rb") as stream:
            data = stream.read(LARGEST + 1)
    except FileNotFoundError:
        raise InputError(str(path), "no such file", what) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(str(path), f"cannot be read ({reason})", what) from None
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
