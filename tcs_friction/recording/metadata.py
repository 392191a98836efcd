"""What metadata.yaml says of a bag directory, and other YAML that comes from bags."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

MAX_SIZE = 1 << 20
"""Bytes of YAML; a bag with 300 topics has 200 kB."""

MAX_DEPTH = 20
"""Levels of YAML; metadata.yaml has seven."""

MAX_FILES = 10_000
"""Storage files of one bag: a day cut every 10 s."""

MAX_FILE_NAME = 255
"""Bytes of a file's name in most file systems."""


MAX_DIGITS = 18
"""Digits of a count of messages."""

_Loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
"""Every scalar stays text, so none is costly to make; libyaml's where there is one."""


class MetadataError(Exception):
    """YAML of a bag that is broken, or larger than any such has to be; says why."""


def listed_files(path: Path) -> tuple[list[str], int | None]:
    """Names of the storage files, each once and without folders, and how many messages they should have, None if unsaid.

    Raises FileNotFoundError, or MetadataError when the file cannot be read or does not say it.
    """
    if not path.exists():
        raise FileNotFoundError(path)
    try:
        if not path.is_file() or path.stat().st_size > MAX_SIZE:
            raise MetadataError(f"no regular file of at most {MAX_SIZE} bytes")
        information = bounded_yaml(path.read_text())["rosbag2_bagfile_information"]
        names = [Path(name).name for name in information["relative_file_paths"]]
        count = information.get("message_count")
    except (OSError, UnicodeDecodeError) as error:
        raise MetadataError(str(error)) from None
    except (KeyError, TypeError, AttributeError):
        raise MetadataError("no list of storage files") from None
    stated = int(count) if isinstance(count, str) and count.isdecimal() and len(count) <= MAX_DIGITS else 0
    return list(dict.fromkeys(name for name in names[:MAX_FILES] if 0 < len(name.encode()) <= MAX_FILE_NAME)), stated or None


def bounded_yaml(text: str) -> Any:
    """YAML from a bag: no aliases, few levels, every scalar as text. Raises MetadataError for anything else."""
    try:
        if len(text) > MAX_SIZE:
            raise MetadataError(f"more than {MAX_SIZE} characters")
        _check(yaml.parse(text, Loader=_Loader))
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, TypeError) as error:
        raise MetadataError(" ".join(str(error).split())[:200]) from None


def _check(events: Iterator[Any]) -> None:
    depth = 0
    for event in events:
        if isinstance(event, yaml.AliasEvent):
            raise MetadataError("an alias")
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise MetadataError(f"more than {MAX_DEPTH} levels")
