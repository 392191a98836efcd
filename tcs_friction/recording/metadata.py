"""What metadata.yaml says of a bag directory."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from tcs_friction.errors import InputError
from tcs_friction.yaml_files import load_yaml

MAX_FILES = 10_000
"""Storage files of one bag: a day cut every 10 s."""

MAX_FILE_NAME = 255
"""Bytes of a file's name in most file systems."""

MOST_MESSAGES = 10**18
"""More than any bag has: counts are kept as 64 bit numbers."""


def listed_files(path: Path) -> tuple[list[str], int | None]:
    """Names of the storage files, each once and without folders, and how many messages they should have, None if unsaid.

    Raises InputError when the file cannot be read or does not say it.
    """
    content = load_yaml(path, "the metadata of a bag")
    try:
        information = content["rosbag2_bagfile_information"]
        names = [Path(name).name for name in information["relative_file_paths"][:MAX_FILES]]
        stated = whole_number(information.get("message_count"), MOST_MESSAGES)
        return list(dict.fromkeys(name for name in names if 0 < len(os.fsencode(name)) <= MAX_FILE_NAME)), stated or None
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError(str(path), "no list of storage files") from None


def whole_number(value: Any, most: int) -> int:
    """A value of YAML as a whole number from 0 to `most`, 0 if it is none."""
    return value if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= most else 0
