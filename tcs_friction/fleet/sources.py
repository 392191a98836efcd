"""Recordings found: in folders, by patterns, on local disks and wherever else fsspec reaches (s3://, http://, memory://).

A folder with metadata.yaml is one recording, and so are its storage files NAME_0, NAME_1, ... where that is lost and the folder
is called NAME. Any other storage file, ROS 1 bag or table is a recording of its own.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

import fsspec
from fsspec.core import url_to_fs

from tcs_friction.errors import InputError
from tcs_friction.recording.bags import SUFFIXES
from tcs_friction.recording.table_files import TABLES as ALL_TABLES

TABLES = tuple(ending for ending in ALL_TABLES if not ending.startswith(".txt"))  # a .txt file in a folder is a remark
METADATA = "metadata.yaml"
GLOB = "*?["
TAGS = ("ETag", "etag", "md5Hash", "content_md5")
"""What stores call the mark that changes with an object's content."""

OF_CONTENT = re.compile(r'"?[0-9a-fA-F]{32}(-\d+)?"?|[A-Za-z0-9+/]{22}==')
"""Marks that are made of the content: MD5, hexadecimal (of S3, in parts or not) or in base64. Others, as of most web servers,
tell the versions of one file apart, and may be equal for two files."""

BLOCK = 1 << 22
MOST_DIGITS = 5  # of the number of a storage file


@dataclass(frozen=True)
class StoredFile:
    """One file: path within its file system, bytes, and what changes when it is written anew (time or mark)."""

    path: str
    size: int
    stamp: str
    tag: str = ""


@dataclass(frozen=True)
class Found:
    """A recording. name: path or URL as it was given, or as what was given led to it. table: whether it is a table."""

    name: str
    protocol: str
    files: tuple[StoredFile, ...]
    folder: bool = False
    table: bool = False

    @property
    def local(self) -> bool:
        """Whether ordinary file access reaches it."""
        return self.protocol == "file"

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(file.size for file in self.files)

    @property
    def look(self) -> str:
        """A cheap name of the content, under which its hash is remembered."""
        parts = [self.name, *(f"{file.path} {file.size} {file.stamp} {file.tag}" for file in self.files)]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()

    def hash(self) -> str:
        """sha256 of the bytes. Where a store has a mark of a file's content, that stands for them, and nothing is fetched."""
        if len(self.files) == 1 and not self.folder:
            return _content(self, self.files[0])
        parts = [f"{PurePosixPath(file.path).name} {_content(self, file)}" for file in self.files]
        return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def filesystem(protocol: str) -> Any:
    """The fsspec file system of a protocol; credentials come from the environment."""
    return fsspec.filesystem(protocol)


def _content(found: Found, file: StoredFile) -> str:
    if file.tag:
        where = "" if OF_CONTENT.fullmatch(file.tag) else f" {file.path}"
        return hashlib.sha256(f"{file.tag} {file.size}{where}".encode()).hexdigest()
    digest = hashlib.sha256()
    with filesystem(found.protocol).open(file.path, "rb", cache_type="readahead") as stream:
        while block := stream.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def find(words: Sequence[str], leave_out: str = "") -> tuple[Found, ...]:
    """Every recording that the paths, patterns and URLs lead to, each once, in order of name. `leave_out`: where results go.

    Raises InputError for a path that is not there, a store that refuses, and when nothing is found.
    """
    found: dict[str, Found] = {}
    for word in words:
        for one in _recordings(word, leave_out):
            found.setdefault(one.name, one)
    if not found:
        raise InputError(" ".join(words), "no recordings", "bags (folders, .mcap, .db3, .bag) or tables (.csv, .parquet, ...)")
    return tuple(found[name] for name in sorted(found))


def _recordings(word: str, leave_out: str) -> Iterator[Found]:
    try:
        fs, path = url_to_fs(word)
        listed = _listing(fs, path, word)
    except InputError:
        raise
    except Exception as error:  # every store has its own
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(word, f"cannot be read ({reason})", "a path or URL") from None
    protocol = "file" if "file" in _protocols(fs) else word.partition("://")[0]
    root = _root(fs, leave_out)
    files = [file for file in listed if not root or not file.path.startswith(root)]

    def name(inner: str) -> str:
        if protocol != "file":
            return str(fs.unstrip_protocol(inner))
        return inner if os.path.isabs(word) else os.path.relpath(inner)

    yield from _grouped(files, protocol, name)


def _protocols(fs: Any) -> tuple[str, ...]:
    return (fs.protocol,) if isinstance(fs.protocol, str) else tuple(fs.protocol)


def _root(fs: Any, leave_out: str) -> str:
    if not leave_out:
        return ""
    other, path = url_to_fs(leave_out)
    return f"{path.rstrip('/')}/" if type(other) is type(fs) else ""


def _listing(fs: Any, path: str, word: str) -> list[StoredFile]:
    """The files at a path, below a folder, or that fit a pattern; a folder that fits counts with all below it."""
    tops: Iterable[str]
    if any(sign in path for sign in GLOB) and not fs.exists(path):
        tops = sorted(fs.glob(path))
    elif fs.exists(path):
        tops = [path]
    else:
        raise InputError(word, "does not exist", "a folder, a bag, a table, or a pattern")
    files: dict[str, StoredFile] = {}
    for top in tops:
        info = fs.info(top)
        entries = {top: info} if info["type"] == "file" else fs.find(top, detail=True)
        files.update((inner, _stored(inner, entry)) for inner, entry in entries.items() if entry["type"] == "file")
    return [files[inner] for inner in sorted(files)]


def _stored(path: str, info: Mapping[str, Any]) -> StoredFile:
    stamp = next((info[key] for key in ("mtime", "LastModified", "last_modified", "updated", "created") if key in info), "")
    tag = next((str(info[key]) for key in TAGS if info.get(key)), "")
    return StoredFile(path, int(info.get("size") or 0), repr(stamp) if isinstance(stamp, float) else str(stamp), tag)


def _grouped(files: Sequence[StoredFile], protocol: str, name: Any) -> Iterator[Found]:
    folders: dict[str, list[StoredFile]] = {}
    for file in files:
        folders.setdefault(file.path.rpartition("/")[0], []).append(file)
    for folder, inside in folders.items():
        bags = [file for file in inside if _suffix(file.path) in SUFFIXES]
        metadata = [file for file in inside if PurePosixPath(file.path).name == METADATA]
        parts = [file for file in bags if _is_part(file.path)]
        if metadata or parts:
            whole = bags if metadata else parts
            yield Found(name(folder), protocol, (*metadata, *whole), folder=True)
            bags = [file for file in bags if file not in whole]
        yield from (Found(name(file.path), protocol, (file,)) for file in bags)
        tables = (file for file in inside if file.path.lower().endswith(TABLES))
        yield from (Found(name(file.path), protocol, (file,), table=True) for file in tables)


def _suffix(path: str) -> str:
    pure = PurePosixPath(path)
    return PurePosixPath(pure.stem).suffix if pure.suffix == ".zstd" else pure.suffix.lower()


def _is_part(path: str) -> bool:
    """Whether a file is one that rosbag2 writes into the folder in which it lies."""
    pure = PurePosixPath(path)
    name, _, number = pure.name.partition(".")[0].rpartition("_")
    counted = len(number) <= MOST_DIGITS and number.isdecimal() and number == str(int(number))  # others are dates, or a user's
    return counted and name == pure.parent.name and _suffix(path) != ".bag"
